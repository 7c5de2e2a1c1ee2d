//! What a synthetic sequence is made of, and its notation as options `--name value`.
//!
//! One table, [`OPTIONS`], serves the command line, recorded commands and error messages.

use super::motion::Model;
use super::texture;
use std::path::{Path, PathBuf};

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
    /// A texture of [`texture::TEXTURES`].
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
    /// Another plane.
    Plane(Source),
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
pub enum Format {
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
    /// Amplitude of the background's own shift, px (with [`Background::Plane`]).
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
    /// Seed of all randomness.
    pub seed: u64,
    /// JPEG quality 1..100.
    pub quality: u8,
    /// File type.
    pub format: Format,
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
            seed: 1,
            quality: 95,
            format: Format::Jpeg,
            tags: vec![],
        }
    }
}

/// An option of the notation.
pub struct SynthOption {
    /// Name without dashes.
    pub name: &'static str,
    get: fn(&SynthSpec) -> String,
    set: fn(&mut SynthSpec, &str) -> Result<(), String>,
}

const fn option(
    name: &'static str,
    get: fn(&SynthSpec) -> String,
    set: fn(&mut SynthSpec, &str) -> Result<(), String>,
) -> SynthOption {
    SynthOption { name, get, set }
}

/// All options, in the order they are recorded in.
pub const OPTIONS: &[SynthOption] = &[
    option(
        "texture",
        |s| drawn(&s.source),
        |s, v| put(&mut s.source, source(v)),
    ),
    option(
        "image",
        |s| file(&s.source),
        |s, v| put(&mut s.source, Ok(Source::File(v.into()))),
    ),
    option(
        "background",
        |s| background_name(&s.background),
        |s, v| put(&mut s.background, background(v)),
    ),
    option(
        "pan",
        |s| s.pan.to_string(),
        |s, v| put(&mut s.pan, number(v, 0.0, 1e4)),
    ),
    option(
        "defocus",
        |s| s.defocus.to_string(),
        |s, v| put(&mut s.defocus, number(v, 0.0, 50.0)),
    ),
    option(
        "soften",
        |s| s.soften.to_string(),
        |s, v| put(&mut s.soften, number(v, 0.0, 50.0)),
    ),
    option(
        "density",
        |s| maybe(s.density),
        |s, v| put(&mut s.density, number(v, 0.01, 100.0).map(Some)),
    ),
    option(
        "tone",
        |s| range_text(s.tone),
        |s, v| put(&mut s.tone, range(v, 0.0, 255.0)),
    ),
    option(
        "size",
        |s| pair_text(s.size, 'x'),
        |s, v| put(&mut s.size, size(v)),
    ),
    option(
        "frames",
        |s| s.frames.to_string(),
        |s, v| put(&mut s.frames, integer(v, 1, 99_999)),
    ),
    option(
        "box",
        |s| pair_text(s.object, 'x'),
        |s, v| put(&mut s.object, pair(v, 'x', 4.0, 1e4)),
    ),
    option(
        "at",
        |s| s.at.map_or(String::new(), |at| pair_text(at, ',')),
        |s, v| put(&mut s.at, pair(v, ',', -1e5, 1e5).map(Some)),
    ),
    option(
        "turn",
        |s| s.turn.to_string(),
        |s, v| put(&mut s.turn, number(v, -360.0, 360.0)),
    ),
    option(
        "lean",
        |s| s.lean.to_string(),
        |s, v| put(&mut s.lean, number(v, -0.9, 0.9)),
    ),
    option(
        "margin",
        |s| s.margin.to_string(),
        |s, v| put(&mut s.margin, number(v, 0.0, 1e4)),
    ),
    option(
        "motion",
        |s| s.model.name().into(),
        |s, v| put(&mut s.model, model(v)),
    ),
    option(
        "mode",
        |s| mode_name(s.mode).into(),
        |s, v| put(&mut s.mode, mode(v)),
    ),
    option(
        "sigma",
        |s| s.sigma.to_string(),
        |s, v| put(&mut s.sigma, number(v, 0.0, 1e3)),
    ),
    option(
        "amplitude",
        |s| s.amplitude.to_string(),
        |s, v| put(&mut s.amplitude, number(v, 0.0, 1e4)),
    ),
    option(
        "speed",
        |s| s.speed.to_string(),
        |s, v| put(&mut s.speed, number(v, 0.0, 1e3)),
    ),
    option(
        "shift",
        |s| maybe(s.shift),
        |s, v| put(&mut s.shift, number(v, 0.0, 1e4).map(Some)),
    ),
    option(
        "rotate",
        |s| maybe(s.rotate),
        |s, v| put(&mut s.rotate, number(v, 0.0, 720.0).map(Some)),
    ),
    option(
        "zoom",
        |s| maybe(s.zoom),
        |s, v| put(&mut s.zoom, number(v, 1.0, 10.0).map(Some)),
    ),
    option(
        "stretch",
        |s| maybe(s.stretch),
        |s, v| put(&mut s.stretch, number(v, 0.0, 2.0).map(Some)),
    ),
    option(
        "tilt",
        |s| maybe(s.tilt),
        |s, v| put(&mut s.tilt, number(v, 0.0, 1.8).map(Some)),
    ),
    option(
        "allow-outside",
        |s| {
            if s.allow_outside {
                "true".into()
            } else {
                String::new()
            }
        },
        |s, v| {
            put(
                &mut s.allow_outside,
                v.parse().map_err(|_| "true or false".into()),
            )
        },
    ),
    option(
        "light",
        |s| light_text(&s.light),
        |s, v| put(&mut s.light, light(v)),
    ),
    option(
        "noise",
        |s| s.noise.to_string(),
        |s, v| put(&mut s.noise, number(v, 0.0, 255.0)),
    ),
    option(
        "blur",
        |s| s.blur.to_string(),
        |s, v| put(&mut s.blur, number(v, 0.0, 4.0)),
    ),
    option(
        "occlude",
        |s| s.occlude.to_string(),
        |s, v| put(&mut s.occlude, number(v, 0.0, 0.95)),
    ),
    option(
        "seed",
        |s| s.seed.to_string(),
        |s, v| put(&mut s.seed, v.parse().map_err(|_| "not a whole number".into())),
    ),
    option(
        "quality",
        |s| s.quality.to_string(),
        |s, v| put(&mut s.quality, integer(v, 1, 100).map(|q| q as u8)),
    ),
    option(
        "format",
        |s| s.format.extension().into(),
        |s, v| put(&mut s.format, format(v)),
    ),
    option("tags", |s| s.tags.join(","), |s, v| put(&mut s.tags, tags(v))),
];

impl Format {
    /// Extension of the files.
    pub fn extension(self) -> &'static str {
        match self {
            Format::Jpeg => "jpg",
            Format::Png => "png",
        }
    }
}

impl SynthSpec {
    /// Sets the option `name` (no dashes) from its text.
    ///
    /// # Errors
    /// [`SynthError::UnknownOption`], or [`SynthError::BadValue`] with the reason.
    pub fn set(&mut self, name: &str, value: &str) -> Result<(), SynthError> {
        let known = OPTIONS.iter().find(|o| o.name == name);
        let option = known.ok_or_else(|| SynthError::UnknownOption(name.into()))?;
        (option.set)(self, value).map_err(|reason| SynthError::BadValue {
            option: option.name,
            value: value.into(),
            reason,
        })
    }

    /// The command that renders this sequence into `out`: every option that differs from the default.
    pub fn command(&self, out: &str) -> String {
        let default = SynthSpec::default();
        let mut text = format!("mtf-eval synth {}", quoted(out));
        for o in OPTIONS {
            let value = (o.get)(self);
            let always = o.name == "texture";
            if !value.is_empty() && (always || value != (o.get)(&default)) {
                text += &match o.name {
                    "allow-outside" => " --allow-outside".to_string(),
                    name => format!(" --{name} {}", quoted(&value)),
                };
            }
        }
        text
    }

    /// Reads a command written by [`SynthSpec::command`]: the output folder and the sequence.
    ///
    /// # Errors
    /// [`SynthError::BadCommand`], and those of [`SynthSpec::set`].
    pub fn parse_command(line: &str) -> Result<(String, SynthSpec), SynthError> {
        let bad = || SynthError::BadCommand(line.into());
        let words = split(line).ok_or_else(bad)?;
        let mut words = words.iter().map(String::as_str);
        if words.next() != Some("mtf-eval") || words.next() != Some("synth") {
            return Err(bad());
        }
        let out = words
            .next()
            .filter(|o| !o.starts_with("--"))
            .ok_or_else(bad)?
            .to_string();
        let mut spec = SynthSpec::default();
        while let Some(word) = words.next() {
            let name = word.strip_prefix("--").ok_or_else(bad)?;
            if name == "allow-outside" {
                spec.set(name, "true")?;
            } else {
                spec.set(name, words.next().ok_or_else(bad)?)?;
            }
        }
        Ok((out, spec))
    }
}

fn put<T>(slot: &mut T, value: Result<T, String>) -> Result<(), String> {
    *slot = value?;
    Ok(())
}

fn number(text: &str, low: f64, high: f64) -> Result<f64, String> {
    let v: f64 = text
        .trim()
        .parse()
        .map_err(|_| format!("'{text}' is not a number"))?;
    if v.is_finite() && (low..=high).contains(&v) {
        Ok(v)
    } else {
        Err(format!("must lie in {low}..{high}"))
    }
}

fn integer(text: &str, low: usize, high: usize) -> Result<usize, String> {
    let v: usize = text
        .trim()
        .parse()
        .map_err(|_| format!("'{text}' is not a whole number"))?;
    if (low..=high).contains(&v) {
        Ok(v)
    } else {
        Err(format!("must lie in {low}..{high}"))
    }
}

fn pair(text: &str, mark: char, low: f64, high: f64) -> Result<[f64; 2], String> {
    let (a, b) = text
        .split_once(mark)
        .ok_or_else(|| format!("two numbers with '{mark}' between them"))?;
    Ok([number(a, low, high)?, number(b, low, high)?])
}

fn pair_text<T: std::fmt::Display>([a, b]: [T; 2], mark: char) -> String {
    format!("{a}{mark}{b}")
}

fn size(text: &str) -> Result<[usize; 2], String> {
    let (w, h) = text.split_once('x').ok_or("width and height, such as 320x240")?;
    Ok([integer(w, 16, 16_384)?, integer(h, 16, 16_384)?])
}

fn range(text: &str, low: f64, high: f64) -> Result<[f64; 2], String> {
    let (a, b) = text.split_once("..").ok_or("a range such as 40..180")?;
    let (a, b) = (number(a, low, high)?, number(b, low, high)?);
    if a <= b {
        Ok([a, b])
    } else {
        Err("the range runs backwards".into())
    }
}

fn range_text([a, b]: [f64; 2]) -> String {
    format!("{a}..{b}")
}

fn maybe(v: Option<f64>) -> String {
    v.map_or(String::new(), |v| v.to_string())
}

fn source(name: &str) -> Result<Source, String> {
    if let Some(t) = texture::find(name) {
        return Ok(Source::Drawn(t.name));
    }
    let names: Vec<_> = texture::TEXTURES.iter().map(|t| t.name).collect();
    let near = names
        .iter()
        .max_by(|a, b| strsim::jaro(a, name).total_cmp(&strsim::jaro(b, name)));
    let hint = near
        .filter(|n| strsim::jaro(n, name) > 0.7)
        .map_or(String::new(), |n| format!("did you mean {n}? "));
    Err(format!("no such texture; {hint}there are {}", names.join(", ")))
}

fn drawn(source: &Source) -> String {
    match source {
        Source::Drawn(name) => (*name).into(),
        Source::File(_) => String::new(),
    }
}

fn file(source: &Source) -> String {
    match source {
        Source::Drawn(_) => String::new(),
        Source::File(path) => path.display().to_string(),
    }
}

fn background(text: &str) -> Result<Background, String> {
    Ok(match text {
        "same" => Background::Same,
        "still" => Background::Still,
        "black" => Background::Black,
        path if texture::find(path).is_none() && Path::new(path).extension().is_some() => {
            Background::Plane(Source::File(path.into()))
        }
        name => Background::Plane(
            source(name).map_err(|e| format!("same, still, black, a file, or a texture: {e}"))?,
        ),
    })
}

fn background_name(b: &Background) -> String {
    match b {
        Background::Same => "same".into(),
        Background::Still => "still".into(),
        Background::Black => "black".into(),
        Background::Plane(s) => drawn(s) + &file(s),
    }
}

fn model(text: &str) -> Result<Model, String> {
    let found = Model::ALL.into_iter().find(|m| m.name() == text);
    found.ok_or_else(|| format!("one of {}", Model::ALL.map(Model::name).join(", ")))
}

fn mode(text: &str) -> Result<Mode, String> {
    let all = [Mode::Smooth, Mode::Continuous, Mode::Independent];
    all.into_iter()
        .find(|m| mode_name(*m) == text)
        .ok_or("one of smooth, continuous, independent".into())
}

fn mode_name(mode: Mode) -> &'static str {
    match mode {
        Mode::Smooth => "smooth",
        Mode::Continuous => "continuous",
        Mode::Independent => "independent",
    }
}

fn format(text: &str) -> Result<Format, String> {
    match text {
        "jpg" | "jpeg" => Ok(Format::Jpeg),
        "png" => Ok(Format::Png),
        _ => Err("jpg or png".into()),
    }
}

fn light(text: &str) -> Result<Light, String> {
    let mut l = SynthSpec::default().light;
    for part in text.split(',').filter(|p| !p.is_empty()) {
        match part.split_once('=') {
            Some(("gain", v)) => {
                l.gain = range(v, 0.01, 10.0)?;
                if l.gain[0] > 1.0 || l.gain[1] < 1.0 {
                    return Err("the gain's range must hold 1, the first frame's gain".into());
                }
            }
            Some(("bias", v)) => l.bias = number(v, 0.0, 255.0)?,
            Some(("shadow", v)) => l.shadow = number(v, 0.0, 1.0)?,
            Some(("spot", v)) => l.spot = number(v, 0.0, 10.0)?,
            Some(("vignette", v)) => l.vignette = number(v, 0.0, 1.0)?,
            None if part == "object" => l.object_only = true,
            _ => {
                return Err(format!(
                    "'{part}': a list of gain=LO..HI, bias=B, shadow=D, spot=S, vignette=D, object"
                ));
            }
        }
    }
    Ok(l)
}

fn light_text(l: &Light) -> String {
    let none = SynthSpec::default().light;
    let mut parts = vec![];
    if l.gain != none.gain {
        parts.push(format!("gain={}", range_text(l.gain)));
    }
    for (name, v) in [
        ("bias", l.bias),
        ("shadow", l.shadow),
        ("spot", l.spot),
        ("vignette", l.vignette),
    ] {
        if v != 0.0 {
            parts.push(format!("{name}={v}"));
        }
    }
    if l.object_only {
        parts.push("object".into());
    }
    parts.join(",")
}

fn tags(text: &str) -> Result<Vec<String>, String> {
    let plain = |t: &str| !t.is_empty() && t.chars().all(|c| c.is_ascii_alphanumeric() || "-_".contains(c));
    let list: Vec<String> = text
        .split(',')
        .filter(|t| !t.is_empty())
        .map(String::from)
        .collect();
    if list.iter().all(|t| plain(t)) {
        Ok(list)
    } else {
        Err("words of letters, digits, - and _, with commas".into())
    }
}

fn quoted(word: &str) -> String {
    let safe = |c: char| c.is_alphanumeric() || "-_./=,:+".contains(c);
    if !word.is_empty() && word.chars().all(safe) {
        word.into()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

/// Splits at blanks as a shell does, with single quotes and backslashes; `None` for an open quote.
fn split(line: &str) -> Option<Vec<String>> {
    let (mut words, mut word, mut open) = (vec![], None::<String>, false);
    let mut chars = line.chars();
    while let Some(c) = chars.next() {
        match c {
            '\'' => {
                open = !open;
                word.get_or_insert_default();
            }
            '\\' if !open => word.get_or_insert_default().push(chars.next()?),
            c if c.is_whitespace() && !open => words.extend(word.take()),
            c => word.get_or_insert_default().push(c),
        }
    }
    words.extend(word);
    (!open).then_some(words)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_read_back() {
        let mut spec = SynthSpec::default();
        for (name, value) in [
            ("image", "a b/it's.png"),
            ("background", "foliage"),
            ("size", "200x150"),
            ("box", "80.5x60"),
            ("at", "100.25,-3"),
            ("motion", "affine"),
            ("mode", "continuous"),
            ("zoom", "1.7"),
            ("light", "gain=0.5..1.5,bias=20,shadow=0.4,object"),
            ("tone", "40..160"),
            ("allow-outside", "true"),
            ("tags", "plain,quick"),
            ("format", "png"),
        ] {
            spec.set(name, value).unwrap();
        }
        let line = spec.command("out dir");
        let (out, again) = SynthSpec::parse_command(&line).unwrap();
        assert_eq!((out.as_str(), &again), ("out dir", &spec), "{line}");
        assert_eq!(again.command("out dir"), line);
    }

    #[test]
    fn bad_values_say_why() {
        let mut spec = SynthSpec::default();
        for (name, value, word) in [
            ("size", "320", "320x240"),
            ("size", "0x240", "16"),
            ("frames", "0", "1.."),
            ("texture", "brick", "bricks"),
            ("speed", "fast", "number"),
            ("speed", "NaN", "must lie"),
            ("motion", "spline", "homography"),
            ("light", "gain=2..3", "hold 1"),
            ("light", "glow=1", "shadow"),
            ("tone", "90..20", "backwards"),
            ("tags", "a b", "words"),
        ] {
            let message = spec.set(name, value).unwrap_err().to_string();
            assert!(message.contains(word) && message.contains(name), "{message}");
        }
        assert_eq!(spec, SynthSpec::default());
        assert!(spec.set("colour", "1").is_err());
        for line in [
            "mtf-eval run x",
            "mtf-eval synth --seed 1",
            "mtf-eval synth x --seed",
            "mtf-eval synth 'x",
        ] {
            assert!(SynthSpec::parse_command(line).is_err(), "{line}");
        }
    }
}
