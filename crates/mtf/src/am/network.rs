//! Convolutional networks as patch features: the parameter that names a file in ONNX format, and the features its
//! network computes.
//!
//! The network has one input of shape `1 x C x H x W`, the patch with its raw intensities (0–255; a network that wants
//! others starts with a scaling of its own), and one output of shape `1 x K x H' x W'`, the feature maps. It is
//! evaluated with the `tract` runtime, which picks its kernels by processor: results are the same from run to run, but
//! not to the last bit on every machine.
//!
//! Needs the cargo feature `onnx`; without it no file is accepted.

use crate::params::ParamValue;

/// Why a file cannot be used as a network.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NetworkError {
    /// The path has characters that tracker expressions cannot hold.
    #[error("the path contains one of , {{ }}")]
    Path,
    /// The program can evaluate no networks.
    #[error("this program was built without networks; build it with `--features onnx`")]
    Unsupported,
    /// The file cannot be read.
    #[error("cannot read the file: {0}")]
    Read(String),
    /// It is not a network, or one with unknown operators.
    #[error("not a usable network in ONNX format: {0}")]
    Format(String),
    /// It has another number of inputs or outputs than one.
    #[error("the network has {inputs} inputs and {outputs} outputs, expected one of each")]
    Ends {
        /// Number of inputs.
        inputs: usize,
        /// Number of outputs.
        outputs: usize,
    },
}

/// A network read from a file; by default none.
#[derive(Clone, Debug, Default)]
pub struct Network {
    path: String,
    #[cfg(feature = "onnx")]
    graph: Option<onnx::Graph>,
}

impl Network {
    /// Reads a network from a file in ONNX format.
    pub fn load(path: &str) -> Result<Self, NetworkError> {
        if path.contains([',', '{', '}']) {
            return Err(NetworkError::Path);
        }
        Self::read(path)
    }

    #[cfg(not(feature = "onnx"))]
    fn read(_path: &str) -> Result<Self, NetworkError> {
        Err(NetworkError::Unsupported)
    }

    #[cfg(feature = "onnx")]
    fn read(path: &str) -> Result<Self, NetworkError> {
        Ok(Network {
            path: path.to_owned(),
            graph: Some(onnx::read(path)?),
        })
    }

    /// The first `maps` maps of the network as features; `None` without a network.
    #[cfg(feature = "onnx")]
    pub(super) fn features(&self, maps: usize) -> Option<Box<dyn super::PatchFeatures>> {
        let graph = self.graph.clone()?;
        Some(Box::new(onnx::Features::new(graph, maps)))
    }

    /// `None`: there are no networks.
    #[cfg(not(feature = "onnx"))]
    pub(super) fn features(&self, _maps: usize) -> Option<Box<dyn super::PatchFeatures>> {
        None
    }
}

/// Networks are the same when they come from the same file.
impl PartialEq for Network {
    fn eq(&self, other: &Self) -> bool {
        self.path == other.path
    }
}

impl ParamValue for Network {
    fn parse(text: &str) -> Option<Self> {
        if text.is_empty() {
            return Some(Self::default());
        }
        Self::load(text).ok()
    }
    fn text(&self) -> String {
        self.path.clone()
    }
    fn allowed() -> String {
        "path of a network in ONNX format, or nothing".to_owned()
    }
    fn explain(text: &str) -> Option<String> {
        Self::load(text).err().map(|e| e.to_string())
    }
}

#[cfg(feature = "onnx")]
mod onnx {
    use super::NetworkError;
    use crate::am::{PatchFeatures, PatchShape};
    use crate::tracker::TrackError;
    use std::collections::BTreeSet;
    use tract_onnx::pb::ModelProto;
    use tract_onnx::prelude::*;

    /// A network whose shapes are still open.
    pub type Graph = Arc<InferenceModel>;
    type Plan = Arc<TypedRunnableModel>;

    /// The innermost cause of a failure, on one line.
    fn reason(e: &TractError) -> String {
        let text = e.root_cause().to_string();
        text.lines().next().unwrap_or_default().to_owned()
    }

    /// Whether the file names its operators' version, and something in the graph makes each of its outputs.
    fn complete(model: &ModelProto) -> bool {
        if model.opset_import.iter().all(|set| set.version == 0) {
            return false;
        }
        let Some(graph) = &model.graph else { return false };
        let made: BTreeSet<&str> = (graph.node.iter().flat_map(|n| &n.output))
            .chain(graph.input.iter().map(|v| &v.name))
            .chain(graph.initializer.iter().map(|t| &t.name))
            .map(String::as_str)
            .collect();
        graph.output.iter().all(|o| made.contains(o.name.as_str()))
    }

    /// Largest file that is read: 1 GiB, which is 268 million weights of 4 bytes. Networks for patches have far fewer.
    const MOST_BYTES: u64 = 1 << 30;

    pub fn read(path: &str) -> Result<Graph, NetworkError> {
        let failed = |e: std::io::Error| NetworkError::Read(e.to_string());
        // Opening a pipe or reading a device may never end.
        let meta = std::fs::metadata(path).map_err(failed)?;
        if !meta.is_file() {
            return Err(NetworkError::Read("not a regular file".to_owned()));
        }
        if meta.len() > MOST_BYTES {
            let reason = format!("{} bytes, more than the limit of {MOST_BYTES}", meta.len());
            return Err(NetworkError::Read(reason));
        }
        let bytes = std::fs::read(path).map_err(failed)?;
        let format = |e: TractError| NetworkError::Format(reason(&e));
        let onnx = tract_onnx::onnx();
        let proto = onnx.proto_model_for_read(&mut &bytes[..]).map_err(format)?;
        if !complete(&proto) {
            return Err(NetworkError::Format("the file is incomplete".to_owned()));
        }
        let graph = onnx.model_for_proto_model(&proto).map_err(format)?;
        let (inputs, outputs) = (graph.inputs.len(), graph.outputs.len());
        if (inputs, outputs) != (1, 1) {
            return Err(NetworkError::Ends { inputs, outputs });
        }
        Ok(Arc::new(graph))
    }

    /// Feature maps of a network.
    #[derive(Clone)]
    pub struct Features {
        graph: Graph,
        most: usize,
        input: [usize; 4],
        plan: Option<Plan>,
        maps: usize,
        map_len: usize,
    }

    impl Features {
        pub fn new(graph: Graph, most: usize) -> Self {
            Features {
                graph,
                most,
                input: [0; 4],
                plan: None,
                maps: 0,
                map_len: 0,
            }
        }

        /// The network for inputs of one shape, and its output's.
        fn fit(&self, input: [usize; 4]) -> TractResult<(Plan, Vec<usize>)> {
            let model = (*self.graph)
                .clone()
                .with_input_fact(0, f32::fact(input).into())?
                .into_optimized()?;
            let fact = model.output_fact(0)?;
            let float = fact.datum_type == f32::datum_type();
            let shape = fact.shape.as_concrete().filter(|_| float).unwrap_or_default();
            let shape = shape.to_vec();
            Ok((model.into_runnable()?, shape))
        }

        fn run(&self, patch: &[f32], out: &mut [f32]) -> TractResult<()> {
            let plan = self
                .plan
                .as_ref()
                .ok_or_else(|| TractError::msg("not prepared"))?;
            let input = Tensor::from_shape(&self.input, patch)?;
            let maps = plan.run(tvec!(input.into()))?;
            let maps = maps[0].to_plain_array_view::<f32>()?;
            for (o, v) in out.iter_mut().zip(maps.iter()) {
                *o = *v;
            }
            Ok(())
        }
    }

    impl PatchFeatures for Features {
        fn prepare(&mut self, shape: PatchShape) -> Result<(), TrackError> {
            let input = [1, shape.channels, shape.res.rows, shape.res.cols];
            if self.plan.is_some() && self.input == input {
                return Ok(());
            }
            let fitted = self.fit(input);
            let Ok((plan, output)) = fitted else {
                return Err(TrackError::Template(
                    "the network takes no patches of this resolution and number of channels",
                ));
            };
            let [1, maps, rows, cols] = output[..] else {
                return Err(TrackError::Template("the network does not put out feature maps"));
            };
            if maps * rows * cols == 0 {
                return Err(TrackError::Template(
                    "the network leaves nothing of so small a patch",
                ));
            }
            (self.input, self.plan) = (input, Some(plan));
            (self.maps, self.map_len) = (maps.min(self.most), rows * cols);
            Ok(())
        }
        fn maps(&self) -> usize {
            self.maps
        }
        fn map_len(&self) -> usize {
            self.map_len
        }
        /// Not numbers where the runtime fails, which trackers report.
        fn evaluate(&self, patch: &[f32], out: &mut [f32]) {
            if self.run(patch, out).is_err() {
                out.fill(f32::NAN);
            }
        }
        fn memory(&self) -> usize {
            4 * self.maps * self.map_len
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_path_is_no_network() {
        let none = Network::parse("").unwrap();
        assert!(none == Network::default() && none.text().is_empty() && none.features(4).is_none());
    }

    #[test]
    fn paths_that_expressions_cannot_hold_are_refused() {
        assert_eq!(Network::load("a,b.onnx").unwrap_err(), NetworkError::Path);
    }

    #[cfg(not(feature = "onnx"))]
    #[test]
    fn without_the_feature_the_error_names_it() {
        let error = Network::explain("some.onnx").unwrap();
        assert!(error.contains("--features onnx"), "{error}");
    }
}
