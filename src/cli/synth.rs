//! `mtf-eval synth`: renders a sequence with exact ground truth.

use super::console::print;
use crate::synth::{Selection, SynthError, SynthSpec, Written, texture, write_builtin, write_sequence};
use anyhow::Context as _;
use std::path::PathBuf;
use std::process::ExitCode;

/// Render an image sequence with exact ground truth, from any image or a texture drawn by code.
///
/// Writes frame00001.jpg, ..., groundtruth.txt (corners UL UR LR LL, pixel centres at integers) and meta.json, which
/// records the command: run again, it gives the same bytes.
#[derive(Debug, Default, clap::Args)]
pub struct SynthArgs {
    /// Folder of the new sequence
    #[arg(required_unless_present_any = ["builtin", "list_textures"])]
    pub out: Option<PathBuf>,
    /// Render the embedded dataset into DIR, one folder per sequence
    #[arg(long, value_name = "DIR", conflicts_with = "out", hide_short_help = true)]
    pub builtin: Option<PathBuf>,
    /// List the textures and stop
    #[arg(long)]
    pub list_textures: bool,
    /// Take the frames of NAME, a sequence in the same folder, instead of rendering any: OUT gets a meta.json and no images
    #[arg(long, value_name = "NAME", conflicts_with = "builtin", hide_short_help = true)]
    pub frames_of: Option<String>,
    /// With --frames-of: take every K-th frame [default: 1]
    #[arg(long, value_name = "K", requires = "frames_of", hide_short_help = true)]
    pub step: Option<String>,
    /// Write into a folder that is not empty
    #[arg(long)]
    pub force: bool,

    /// Texture of the object [default: rock]; see --list-textures
    #[arg(long, value_name = "NAME", help_heading = "Scene", conflicts_with = "image")]
    pub texture: Option<String>,
    /// Image of the object
    #[arg(long, value_name = "FILE", help_heading = "Scene")]
    pub image: Option<String>,
    /// Around the object: same (its plane goes on), still, black, a texture or an image file [default: same]
    #[arg(long, value_name = "WHAT", help_heading = "Scene")]
    pub background: Option<String>,
    /// Shift amplitude of the background, px [default: 0]
    #[arg(long, value_name = "PX", help_heading = "Scene", hide_short_help = true)]
    pub pan: Option<String>,
    /// Blur of the background, sigma in px [default: 0]
    #[arg(long, value_name = "PX", help_heading = "Scene", hide_short_help = true)]
    pub defocus: Option<String>,
    /// Blur of the object, sigma in px: a soft lens [default: 0]
    #[arg(long, value_name = "PX", help_heading = "Scene", hide_short_help = true)]
    pub soften: Option<String>,
    /// Texels (pixels of the texture) per px in the first frame [default: the image fills the object, or with `same` and `still` the frame]
    #[arg(long, value_name = "N", help_heading = "Scene", hide_short_help = true)]
    pub density: Option<String>,
    /// Gray levels that the textures' 0 and 255 become [default: 0..255]
    #[arg(long, value_name = "LO..HI", help_heading = "Scene", hide_short_help = true)]
    pub tone: Option<String>,
    /// Size of the tracked box in the first frame, px [default: 120x96]
    #[arg(long = "box", value_name = "WxH", help_heading = "Scene")]
    pub object: Option<String>,
    /// Centre of the box in the first frame, px [default: near the middle]
    #[arg(long, value_name = "X,Y", help_heading = "Scene", allow_hyphen_values = true)]
    pub at: Option<String>,
    /// Rotation of the box in the first frame, degrees [default: 0]
    #[arg(
        long,
        value_name = "DEG",
        help_heading = "Scene",
        allow_hyphen_values = true,
        hide_short_help = true
    )]
    pub turn: Option<String>,
    /// Perspective of the box in the first frame: change of depth across it, as a share of the depth [default: 0]
    #[arg(
        long,
        value_name = "F",
        help_heading = "Scene",
        allow_hyphen_values = true,
        hide_short_help = true
    )]
    pub lean: Option<String>,
    /// How far the object's sheet goes on beyond the box, px [default: 8]
    #[arg(long, value_name = "PX", help_heading = "Scene", hide_short_help = true)]
    pub margin: Option<String>,

    /// Family of warps: translation, isometry, similitude, affine, homography [default: homography]
    #[arg(long, value_name = "MODEL", help_heading = "Motion")]
    pub motion: Option<String>,
    /// smooth, or random warps: continuous (accumulated), independent [default: smooth]
    #[arg(long, value_name = "MODE", help_heading = "Motion")]
    pub mode: Option<String>,
    /// Corner motion of a random warp, standard deviation in px [default: 3]
    #[arg(long, value_name = "PX", help_heading = "Motion", hide_short_help = true)]
    pub sigma: Option<String>,
    /// Greatest corner displacement of a smooth motion, roughly, px [default: 30]
    #[arg(long, value_name = "PX", help_heading = "Motion", hide_short_help = true)]
    pub amplitude: Option<String>,
    /// Mean corner motion of a smooth motion, px per frame [default: 2]
    #[arg(long, value_name = "PX", help_heading = "Motion")]
    pub speed: Option<String>,
    /// Shift amplitude, px [default: from --amplitude, like the next four]
    #[arg(long, value_name = "PX", help_heading = "Motion", hide_short_help = true)]
    pub shift: Option<String>,
    /// Rotation amplitude, degrees
    #[arg(long, value_name = "DEG", help_heading = "Motion", hide_short_help = true)]
    pub rotate: Option<String>,
    /// Greatest magnification, a factor; its inverse is the least
    #[arg(long, value_name = "F", help_heading = "Motion", hide_short_help = true)]
    pub zoom: Option<String>,
    /// Amplitude of shear and of half the logarithm of the aspect ratio, a plain number
    #[arg(long, value_name = "F", help_heading = "Motion", hide_short_help = true)]
    pub stretch: Option<String>,
    /// Perspective amplitude: change of depth across the box, as a share of the depth
    #[arg(long, value_name = "F", help_heading = "Motion", hide_short_help = true)]
    pub tilt: Option<String>,
    /// Bend the object like a page: shift of its points within its plane, px; writes dense ground truth [default: 0]
    #[arg(long, value_name = "PX", help_heading = "Motion", hide_short_help = true)]
    pub bend: Option<String>,
    /// Let corners leave the frame (otherwise the motion is scaled down until they stay inside)
    #[arg(long, help_heading = "Motion", hide_short_help = true)]
    pub allow_outside: bool,

    /// Changes of light: a list of gain=LO..HI (factors), bias=B (gray levels), shadow=D, spot=S, vignette=D (shares), and `object`
    /// to spare the rest
    #[arg(long, value_name = "LIST", help_heading = "Effects")]
    pub light: Option<String>,
    /// Gaussian noise, standard deviation in gray levels [default: 0]
    #[arg(long, value_name = "SIGMA", help_heading = "Effects")]
    pub noise: Option<String>,
    /// Motion blur: exposure as a share of the time between frames [default: 0]
    #[arg(long, value_name = "F", help_heading = "Effects")]
    pub blur: Option<String>,
    /// Greatest share of the object covered by patches that cross it [default: 0]
    #[arg(long, value_name = "F", help_heading = "Effects", hide_short_help = true)]
    pub occlude: Option<String>,
    /// Two specular highlights that wander over the object: intensity 0-255 that their middles add [default: 0]
    #[arg(long, value_name = "I", help_heading = "Effects", hide_short_help = true)]
    pub glare: Option<String>,
    /// Exposure that jumps every 5 to 12 frames, by a factor from 1/F to F [default: 1]
    #[arg(long, value_name = "F", help_heading = "Effects", hide_short_help = true)]
    pub exposure: Option<String>,
    /// Photon noise: electrons that intensity 255 frees in a pixel, 0 for none [default: 0]
    #[arg(long, value_name = "N", help_heading = "Effects", hide_short_help = true)]
    pub photons: Option<String>,
    /// An identical second object behind the first circles it at so many boxes, 0 for none [default: 0]
    #[arg(long, value_name = "BOXES", help_heading = "Effects", hide_short_help = true)]
    pub twin: Option<String>,

    /// Frame size, px [default: 320x240]
    #[arg(long, value_name = "WxH", help_heading = "Output")]
    pub size: Option<String>,
    /// Number of frames [default: 60]
    #[arg(long, value_name = "N", help_heading = "Output")]
    pub frames: Option<String>,
    /// Seed of all randomness [default: 1]
    #[arg(long, value_name = "N", help_heading = "Output")]
    pub seed: Option<String>,
    /// Form of the frames: jpg or png [default: jpg]
    #[arg(long, value_name = "TYPE", help_heading = "Output")]
    pub format: Option<String>,
    /// JPEG quality, 1-100 [default: 95]
    #[arg(long, value_name = "Q", help_heading = "Output", hide_short_help = true)]
    pub quality: Option<String>,
    /// What is hard about the sequence, for --tag
    #[arg(long, value_name = "A,B", help_heading = "Output", hide_short_help = true)]
    pub tags: Option<String>,
}

impl SynthArgs {
    /// The sequence these options describe.
    ///
    /// # Errors
    /// The first option that cannot be used, and why.
    pub fn spec(&self) -> Result<SynthSpec, SynthError> {
        let mut spec = SynthSpec::default();
        let given = [
            ("texture", &self.texture),
            ("image", &self.image),
            ("background", &self.background),
            ("pan", &self.pan),
            ("defocus", &self.defocus),
            ("soften", &self.soften),
            ("density", &self.density),
            ("tone", &self.tone),
            ("box", &self.object),
            ("at", &self.at),
            ("turn", &self.turn),
            ("lean", &self.lean),
            ("margin", &self.margin),
            ("motion", &self.motion),
            ("mode", &self.mode),
            ("sigma", &self.sigma),
            ("amplitude", &self.amplitude),
            ("speed", &self.speed),
            ("shift", &self.shift),
            ("rotate", &self.rotate),
            ("zoom", &self.zoom),
            ("stretch", &self.stretch),
            ("tilt", &self.tilt),
            ("bend", &self.bend),
            ("light", &self.light),
            ("noise", &self.noise),
            ("blur", &self.blur),
            ("occlude", &self.occlude),
            ("glare", &self.glare),
            ("exposure", &self.exposure),
            ("photons", &self.photons),
            ("twin", &self.twin),
            ("size", &self.size),
            ("frames", &self.frames),
            ("seed", &self.seed),
            ("format", &self.format),
            ("quality", &self.quality),
            ("tags", &self.tags),
        ];
        for (name, value) in given {
            if let Some(value) = value {
                spec.set(name, value)?;
            }
        }
        spec.allow_outside = self.allow_outside;
        Ok(spec)
    }
}

/// Renders what `args` ask for; a line to `say` for each sequence.
///
/// # Errors
/// An option, an image or the folder is unusable (exit code 2).
pub fn run(args: &SynthArgs, say: &dyn Fn(&str)) -> anyhow::Result<ExitCode> {
    let report = |name: &str, w: &Written| {
        say(&format!(
            "{name}: {} frames, {:.2} MB, corner motion {:.2} px/frame (at most {:.2})",
            w.frames,
            w.bytes as f64 / 1e6,
            w.mean_speed,
            w.max_speed
        ));
    };
    if args.list_textures {
        let line = |t: &texture::Texture| format!("{:10} {}\n", t.name, t.about);
        print(&texture::TEXTURES.iter().map(line).collect::<String>())?;
    } else if let Some(dir) = &args.builtin {
        write_builtin(dir, args.force, |name, written| match written {
            Some(written) => report(name, written),
            None => say(&format!("{name}: frames of another sequence")),
        })?;
    } else {
        let out = args
            .out
            .as_deref()
            .context("the folder of the new sequence is missing")?;
        let shown = out.display().to_string();
        if let Some(of) = &args.frames_of {
            let rest = SynthSpec {
                tags: vec![],
                ..args.spec()?
            };
            anyhow::ensure!(
                rest == SynthSpec::default(),
                "--frames-of takes frames as they are: of what says how to render, only --tags goes with it"
            );
            Selection::new(of, args.step.as_deref(), args.tags.as_deref())?.write(out, args.force)?;
            say(&format!("{shown}: frames of {of}"));
        } else {
            report(&shown, &write_sequence(&args.spec()?, out, args.force)?);
        }
    }
    Ok(ExitCode::SUCCESS)
}
