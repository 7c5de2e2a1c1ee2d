//! What a synthetic sequence is made of, and what can be wrong with it.

use super::motion::Model;
use std::path::PathBuf;

/// Why a sequence cannot be specified, rendered or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SynthError {
    /// An option does not exist.
    #[error("unknown option --{0}")]
    UnknownOption(String),
    /// An option's value cannot be used.
    #[error("--{option} {value}: {reason}")]
    BadValue {
        /// Option name.
        option: &'static str,
        /// Value given.
        value: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A recorded command is not one.
    #[error("not a synth command: {0}")]
    BadCommand(String),
    /// The options contradict each other or the motion cannot be had.
    #[error("{0}")]
    Impossible(String),
    /// An image cannot be read.
    #[error("cannot read image {path}: {reason}")]
    Image {
        /// File.
        path: PathBuf,
        /// Cause.
        reason: String,
    },
    /// A folder that holds something already.
    #[error("{0} is not empty (--force writes into it all the same)")]
    NotEmpty(PathBuf),
    /// A file or folder cannot be written.
    #[error("cannot write {path}: {reason}")]
    Write {
        /// File or folder.
        path: PathBuf,
        /// Cause.
        reason: String,
    },
}

/// Where the texels of a plane come from.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// A texture of [`super::texture::TEXTURES`].
    Drawn(&'static str),
    /// An image file.
    File(PathBuf),
}

/// What is seen around the object.
#[derive(Clone, Debug, PartialEq)]
pub enum Background {
    /// The object's own plane goes on (mirrored at its border) and moves with it.
    Same,
    /// The object's plane as in the first frame, at rest.
    Still,
    /// Nothing.
    Black,
    /// Another texture or image, at rest but for a shift of its own.
    Surface(Source),
}

/// How the motion comes about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mode {
    /// Smooth curves.
    Smooth,
    /// A random warp composed onto the previous frame's.
    Continuous,
    /// A random warp of the first frame, each frame anew.
    Independent,
}

impl Mode {
    /// All.
    pub const ALL: [Mode; 3] = [Mode::Smooth, Mode::Continuous, Mode::Independent];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Mode::Smooth => "smooth",
            Mode::Continuous => "continuous",
            Mode::Independent => "independent",
        }
    }
}

/// Changes of light: `I' = gain(t) shade(x, y, t) I + bias(t)`; at frame 0 gain is 1 and bias 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Least and greatest gain.
    pub gain: [f64; 2],
    /// Greatest absolute bias, intensity 0–255.
    pub bias: f64,
    /// Depth of a soft stripe of shadow that crosses the scene, 0..1.
    pub shadow: f64,
    /// Strength of a roaming spot of light (relative).
    pub spot: f64,
    /// Darkening of the frame's corners, 0..1.
    pub vignette: f64,
    /// Whether only the object is affected.
    pub object_only: bool,
}

/// File type of the frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileType {
    /// JPEG, 4:2:0.
    Jpeg,
    /// PNG, lossless.
    Png,
}

/// Everything that determines a sequence's bytes. [`SynthSpec::default`] gives the defaults of the command line.
#[derive(Clone, Debug, PartialEq)]
pub struct SynthSpec {
    /// Texture of the object's plane.
    pub source: Source,
    /// What surrounds the object.
    pub background: Background,
    /// Amplitude of the background's own shift, px (with [`Background::Surface`]).
    pub pan: f64,
    /// Standard deviation of the Gaussian that puts the background out of focus, px.
    pub defocus: f64,
    /// The same for the object: how soft the lens draws, px.
    pub soften: f64,
    /// Texels per pixel in the first frame; `None`: the texture fills the object, or with
    /// [`Background::Same`] and [`Background::Still`] a little more than the frame.
    pub density: Option<f64>,
    /// Texture intensities 0..255 are mapped linearly to this range.
    pub tone: [f64; 2],
    /// Frame width and height, px.
    pub size: [usize; 2],
    /// Number of frames.
    pub frames: usize,
    /// Width and height of the tracked box in the first frame, px.
    pub object: [f64; 2],
    /// Centre of the box in the first frame, px; `None`: near the middle, off the pixel grid.
    pub at: Option<[f64; 2]>,
    /// Rotation of the box in the first frame, degrees clockwise.
    pub turn: f64,
    /// Perspective of the box in the first frame: relative change of depth across it.
    pub lean: f64,
    /// How far the object's sheet goes on beyond the tracked box, px.
    pub margin: f64,
    /// Family of warps.
    pub model: Model,
    /// How the motion comes about.
    pub mode: Mode,
    /// Standard deviation of a random warp's corner motion, px per coordinate ([`Mode::Continuous`],
    /// [`Mode::Independent`]).
    pub sigma: f64,
    /// Corner displacement that the smooth motion's amplitudes are derived from, px.
    pub amplitude: f64,
    /// Mean corner motion between frames, px ([`Mode::Smooth`]).
    pub speed: f64,
    /// Shift amplitude, px, instead of the one derived.
    pub shift: Option<f64>,
    /// Rotation amplitude, degrees, instead of the one derived.
    pub rotate: Option<f64>,
    /// Greatest magnification (its inverse is the least), instead of the one derived.
    pub zoom: Option<f64>,
    /// Amplitude of log aspect ratio / 2 and of shear, instead of the one derived.
    pub stretch: Option<f64>,
    /// Perspective amplitude: relative change of depth across the box, instead of the one derived.
    pub tilt: Option<f64>,
    /// How far the sheet's points shift within its plane as it bends like a page, px; such a sequence has dense truth.
    pub bend: f64,
    /// Whether corners may leave the frame.
    pub allow_outside: bool,
    /// Changes of light.
    pub light: Light,
    /// Standard deviation of Gaussian noise, the same in all colours, intensity 0–255.
    pub noise: f64,
    /// Exposure time as a fraction of the time between frames: motion blur. Truth is at mid-exposure.
    pub blur: f64,
    /// Greatest fraction of the object covered by patches that cross it; none in the first frame.
    pub occlude: f64,
    /// Intensity (0–255) that the middle of a specular highlight adds; 0: none.
    pub glare: f64,
    /// Greatest factor by which the exposure jumps (its inverse is the least); 1: none.
    pub exposure: f64,
    /// Electrons that intensity 255 frees in a pixel: photon noise; 0: none.
    pub photons: f64,
    /// Distance of an identical second object in boxes; 0: there is none.
    pub twin: f64,
    /// Seed of all randomness.
    pub seed: u64,
    /// JPEG quality 1..100.
    pub quality: u8,
    /// File type.
    pub format: FileType,
    /// What is hard about the sequence.
    pub tags: Vec<String>,
}

impl Default for SynthSpec {
    fn default() -> Self {
        SynthSpec {
            source: Source::Drawn("rock"),
            background: Background::Same,
            pan: 0.0,
            defocus: 0.0,
            soften: 0.0,
            density: None,
            tone: [0.0, 255.0],
            size: [320, 240],
            frames: 60,
            object: [120.0, 96.0],
            at: None,
            turn: 0.0,
            lean: 0.0,
            margin: 8.0,
            model: Model::Homography,
            mode: Mode::Smooth,
            sigma: 3.0,
            amplitude: 30.0,
            speed: 2.0,
            shift: None,
            rotate: None,
            zoom: None,
            stretch: None,
            tilt: None,
            bend: 0.0,
            allow_outside: false,
            light: Light {
                gain: [1.0, 1.0],
                bias: 0.0,
                shadow: 0.0,
                spot: 0.0,
                vignette: 0.0,
                object_only: false,
            },
            noise: 0.0,
            blur: 0.0,
            occlude: 0.0,
            glare: 0.0,
            exposure: 1.0,
            photons: 0.0,
            twin: 0.0,
            seed: 1,
            quality: 95,
            format: FileType::Jpeg,
            tags: vec![],
        }
    }
}

impl FileType {
    /// Extension of the files.
    pub fn extension(self) -> &'static str {
        match self {
            FileType::Jpeg => "jpg",
            FileType::Png => "png",
        }
    }
}
