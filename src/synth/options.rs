//! The notation of a [`SynthSpec`]: options `--name value`.
//!
//! One table, [`OPTIONS`], serves the command line, recorded commands and error messages.

use super::motion::Model;
use super::spec::{Background, FileType, Light, Mode, Source, SynthError, SynthSpec};
use super::texture;
use mtf::registry::{hint, suggest};
use std::path::Path;

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
#[rustfmt::skip]
pub const OPTIONS: &[SynthOption] = &[
    option("texture", |s| drawn(&s.source), |s, v| put(&mut s.source, source(v))),
    option("image", |s| file(&s.source), |s, v| put(&mut s.source, Ok(Source::File(v.into())))),
    option("background", |s| background_name(&s.background), |s, v| put(&mut s.background, background(v))),
    option("pan", |s| s.pan.to_string(), |s, v| put(&mut s.pan, number(v, 0.0, 1e4))),
    option("defocus", |s| s.defocus.to_string(), |s, v| put(&mut s.defocus, number(v, 0.0, 50.0))),
    option("soften", |s| s.soften.to_string(), |s, v| put(&mut s.soften, number(v, 0.0, 50.0))),
    option("density", |s| maybe(s.density), |s, v| put(&mut s.density, number(v, 0.01, 100.0).map(Some))),
    option("tone", |s| range_text(s.tone), |s, v| put(&mut s.tone, range(v, 0.0, 255.0))),
    option("size", |s| pair_text(s.size, 'x'), |s, v| put(&mut s.size, size(v))),
    option("frames", |s| s.frames.to_string(), |s, v| put(&mut s.frames, integer(v, 1, 99_999))),
    option("box", |s| pair_text(s.object, 'x'), |s, v| put(&mut s.object, pair(v, 'x', 4.0, 1e4))),
    option("at", |s| s.at.map_or(String::new(), |at| pair_text(at, ',')),
        |s, v| put(&mut s.at, pair(v, ',', -1e5, 1e5).map(Some))),
    option("turn", |s| s.turn.to_string(), |s, v| put(&mut s.turn, number(v, -360.0, 360.0))),
    option("lean", |s| s.lean.to_string(), |s, v| put(&mut s.lean, number(v, -0.9, 0.9))),
    option("margin", |s| s.margin.to_string(), |s, v| put(&mut s.margin, number(v, 0.0, 1e4))),
    option("motion", |s| s.model.name().into(), |s, v| put(&mut s.model, choice(v, &Model::ALL, Model::name))),
    option("mode", |s| s.mode.name().into(), |s, v| put(&mut s.mode, choice(v, &Mode::ALL, Mode::name))),
    option("sigma", |s| s.sigma.to_string(), |s, v| put(&mut s.sigma, number(v, 0.0, 1e3))),
    option("amplitude", |s| s.amplitude.to_string(), |s, v| put(&mut s.amplitude, number(v, 0.0, 1e4))),
    option("speed", |s| s.speed.to_string(), |s, v| put(&mut s.speed, number(v, 0.01, 1e3))),
    option("shift", |s| maybe(s.shift), |s, v| put(&mut s.shift, number(v, 0.0, 1e4).map(Some))),
    option("rotate", |s| maybe(s.rotate), |s, v| put(&mut s.rotate, number(v, 0.0, 720.0).map(Some))),
    option("zoom", |s| maybe(s.zoom), |s, v| put(&mut s.zoom, number(v, 1.0, 10.0).map(Some))),
    option("stretch", |s| maybe(s.stretch), |s, v| put(&mut s.stretch, number(v, 0.0, 2.0).map(Some))),
    option("tilt", |s| maybe(s.tilt), |s, v| put(&mut s.tilt, number(v, 0.0, 1.8).map(Some))),
    option("bend", |s| s.bend.to_string(), |s, v| put(&mut s.bend, number(v, 0.0, 1e3))),
    option("allow-outside", |s| { if s.allow_outside { "true".into() } else { String::new() } },
        |s, v| put(&mut s.allow_outside, v.parse().map_err(|_| "true or false".into()))),
    option("light", |s| light_text(&s.light), |s, v| put(&mut s.light, light(v))),
    option("noise", |s| s.noise.to_string(), |s, v| put(&mut s.noise, number(v, 0.0, 255.0))),
    option("blur", |s| s.blur.to_string(), |s, v| put(&mut s.blur, number(v, 0.0, 4.0))),
    option("occlude", |s| s.occlude.to_string(), |s, v| put(&mut s.occlude, number(v, 0.0, 0.95))),
    option("glare", |s| s.glare.to_string(), |s, v| put(&mut s.glare, number(v, 0.0, 1e3))),
    option("exposure", |s| s.exposure.to_string(), |s, v| put(&mut s.exposure, number(v, 1.0, 100.0))),
    option("photons", |s| s.photons.to_string(), |s, v| put(&mut s.photons, number(v, 0.0, 1e9))),
    option("twin", |s| s.twin.to_string(), |s, v| put(&mut s.twin, number(v, 0.0, 100.0))),
    option("seed", |s| s.seed.to_string(),
        |s, v| put(&mut s.seed, v.parse().map_err(|_| "not a whole number".into()))),
    option("quality", |s| s.quality.to_string(), |s, v| put(&mut s.quality, integer(v, 1, 100).map(|q| q as u8))),
    option("format", |s| s.format.extension().into(), |s, v| put(&mut s.format, file_type(v))),
    option("tags", |s| s.tags.join(","), |s, v| put(&mut s.tags, tags(v))),
];

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

    /// Whether every option has a value that [`SynthSpec::set`] takes.
    pub(crate) fn validate(&self) -> Result<(), SynthError> {
        let mut again = SynthSpec::default();
        let given = OPTIONS
            .iter()
            .map(|o| (o, (o.get)(self)))
            .filter(|(_, v)| !v.is_empty());
        for (option, value) in given {
            again.set(option.name, &value)?;
        }
        Ok(())
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
        let command = Command::parse(line)?;
        let mut spec = SynthSpec::default();
        for (name, value) in &command.options {
            spec.set(name, value)?;
        }
        Ok((command.out, spec))
    }
}

/// A recorded command in its parts.
pub(super) struct Command {
    /// The output folder.
    pub out: String,
    /// Names, without dashes, and values.
    pub options: Vec<(String, String)>,
}

impl Command {
    /// Takes `mtf-eval synth OUT --name value ...` apart.
    pub fn parse(line: &str) -> Result<Self, SynthError> {
        let bad = || SynthError::BadCommand(line.into());
        let words = split(line).ok_or_else(bad)?;
        let mut words = words.into_iter();
        if words.next().as_deref() != Some("mtf-eval") || words.next().as_deref() != Some("synth") {
            return Err(bad());
        }
        let out = words.next().filter(|o| !o.starts_with("--")).ok_or_else(bad)?;
        let mut options = Vec::new();
        while let Some(word) = words.next() {
            let name = word.strip_prefix("--").ok_or_else(bad)?;
            let value = match name {
                "allow-outside" => "true".into(),
                _ => words.next().ok_or_else(bad)?,
            };
            options.push((name.to_string(), value));
        }
        Ok(Command { out, options })
    }

    /// The value of the option `name`.
    pub fn value(&self, name: &str) -> Option<&str> {
        let option = self.options.iter().find(|(n, _)| n == name)?;
        Some(&option.1)
    }
}

fn put<T>(slot: &mut T, value: Result<T, String>) -> Result<(), String> {
    *slot = value?;
    Ok(())
}

fn number(text: &str, low: f64, high: f64) -> Result<f64, String> {
    parsed(text, "a number", low, high)
}

fn integer(text: &str, low: usize, high: usize) -> Result<usize, String> {
    parsed(text, "a whole number", low, high)
}

/// A value between `low` and `high`.
fn parsed<T>(text: &str, what: &str, low: T, high: T) -> Result<T, String>
where
    T: Copy + std::str::FromStr + PartialOrd + std::fmt::Display,
{
    let value: T = text
        .trim()
        .parse()
        .map_err(|_| format!("'{text}' is not {what}"))?;
    // Not a number does not lie anywhere.
    if (low..=high).contains(&value) {
        Ok(value)
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
    let hint = hint(suggest(name, names.iter().copied()).as_deref());
    Err(format!("no such texture{hint} (one of {})", names.join(", ")))
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
            Background::Surface(Source::File(path.into()))
        }
        name => Background::Surface(
            source(name).map_err(|e| format!("same, still, black, a file, or a texture: {e}"))?,
        ),
    })
}

fn background_name(b: &Background) -> String {
    match b {
        Background::Same => "same".into(),
        Background::Still => "still".into(),
        Background::Black => "black".into(),
        Background::Surface(s) => drawn(s) + &file(s),
    }
}

/// The one of `all` that is called `text`.
fn choice<T: Copy>(text: &str, all: &[T], name: fn(T) -> &'static str) -> Result<T, String> {
    let found = all.iter().find(|value| name(**value) == text);
    found.copied().ok_or_else(|| {
        let names: Vec<_> = all.iter().map(|value| name(*value)).collect();
        format!("one of {}", names.join(", "))
    })
}

fn file_type(text: &str) -> Result<FileType, String> {
    match text {
        "jpg" | "jpeg" => Ok(FileType::Jpeg),
        "png" => Ok(FileType::Png),
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

pub(super) fn tags(text: &str) -> Result<Vec<String>, String> {
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

pub(super) fn quoted(word: &str) -> String {
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
