//! Rendering: every frame is the area average of textured planes seen through their warps, backward and anti-aliased.
//!
//! A pixel is the mean of n x n bilinear samples over its square; n grows with the texels per pixel. Work is spread
//! over rows, each computed from the specification alone: bytes do not depend on threads. Depends on `geom` only.

use super::bend::{self, Bend};
use super::canvas::length;
use super::exposure;
use super::glare::Glare;
use super::light::Lighting;
use super::motion::{Curves, Pose, shift};
use super::occlude::{self, Occluder};
use super::photons;
use super::random::Random;
use super::spec::{Background, Mode, Source, SynthError, SynthSpec};
use super::surface::Surface;
use super::texture;
use super::trajectory::{Trajectory, affine_misfit, project};
use super::twin::Twin;
use crate::files;
use image::RgbImage;
use mtf::geom::{Corners, Mat3, homography};
use rayon::prelude::*;

/// What a sequence shows, ready to be rendered frame by frame, in any order.
pub struct Scene {
    spec: SynthSpec,
    path: Trajectory,
    object: Surface,
    background: Option<Surface>,
    pan: Curves,
    occluders: Vec<Occluder>,
    patches: Vec<Surface>,
    lighting: Option<Lighting>,
    bend: Option<Bend>,
    glare: Option<Glare>,
    /// Factor of each frame; empty: none.
    exposure: Vec<f64>,
    twin: Option<Twin>,
}

/// A surface at one instant.
struct Layer<'a> {
    surface: &'a Surface,
    /// Frame to texels.
    map: Mat3,
    /// Frame to the plane of the sheet.
    sheet: Mat3,
    /// Half size of the sheet; `None`: without end.
    half: Option<[f64; 2]>,
    /// How the sheet bends, and how much.
    bend: Option<(Bend, f64)>,
    /// Part of the frame it may be seen in: `[x0, y0, x1, y1]`.
    bounds: [f64; 4],
    /// Whether it is the object.
    object: bool,
}

const STREAM_PATH: u64 = 2;
const STREAM_LIGHT: u64 = 3;
const STREAM_PAN: u64 = 4;
const STREAM_OCCLUDE: u64 = 5;
const STREAM_GLARE: u64 = 6;
const STREAM_EXPOSURE: u64 = 7;
const STREAM_TWIN: u64 = 8;
const STREAM_NOISE: u64 = 1 << 40;
const STREAM_PHOTONS: u64 = 1 << 41;

/// Points of the grid of dense truth per side.
const DENSE_SIDE: usize = 10;

/// Prepares the sequence of `spec`: draws or reads its textures and computes its path.
///
/// # Errors
/// [`SynthError::BadValue`] for a value out of range, [`SynthError::Image`] for an unreadable image,
/// [`SynthError::Impossible`] when the motion cannot be had.
pub fn render_sequence(spec: &SynthSpec) -> Result<Scene, SynthError> {
    Scene::new(spec)
}

/// All frames of `spec` with their corners, in memory.
///
/// # Errors
/// Those of [`render_sequence`].
pub fn frames(spec: &SynthSpec) -> Result<Vec<(RgbImage, Corners)>, SynthError> {
    Ok(Scene::new(spec)?.iter().collect())
}

fn load(source: &Source, seed: u64) -> Result<RgbImage, SynthError> {
    match source {
        Source::Drawn(name) => {
            let t = texture::find(name);
            Ok(
                t.ok_or_else(|| SynthError::Impossible(format!("no texture {name}")))?
                    .draw(seed),
            )
        }
        Source::File(path) => {
            let failed = |reason: String| SynthError::Image {
                path: path.clone(),
                reason,
            };
            let bytes = files::read(path, files::Kind::IMAGE).map_err(|e| failed(e.to_string()))?;
            let image = image::load_from_memory(&bytes).map_err(|e| failed(e.to_string()))?;
            Ok(image.to_rgb8())
        }
    }
}

/// Texels per pixel when `image` just covers `width` x `height` pixels.
fn covering(image: &RgbImage, width: f64, height: f64) -> f64 {
    (f64::from(image.width()) / width).min(f64::from(image.height()) / height)
}

impl Scene {
    fn new(spec: &SynthSpec) -> Result<Self, SynthError> {
        spec.validate()?;
        if spec.bend > bend::MOST * spec.object[0] {
            return Err(SynthError::Impossible(format!(
                "--bend {} folds a box {} px wide; at most {:.1}",
                spec.bend,
                spec.object[0],
                bend::MOST * spec.object[0]
            )));
        }
        if spec.twin > 0.0 && spec.background == Background::Same {
            return Err(SynthError::Impossible(
                "--twin needs a --background behind the object; with `same` its plane has no end".into(),
            ));
        }
        let path = Trajectory::new(spec, &mut Random::new(spec.seed, STREAM_PATH))?;
        let image = load(&spec.source, spec.seed)?;
        let [w, h] = spec.size.map(|n| n as f64);
        let sheet = spec.object.map(|n| n + 2.0 * spec.margin);
        let whole = matches!(spec.background, Background::Same | Background::Still);
        let fitting = if whole {
            covering(&image, 1.2 * w, 1.2 * h)
        } else {
            covering(&image, sheet[0], sheet[1])
        };
        let density = spec.density.unwrap_or(fitting);
        let object = Surface::new(&image, density, spec.soften, spec.tone);
        let background = match &spec.background {
            Background::Same | Background::Black => None,
            Background::Still => Some(Surface::new(&image, density, spec.defocus, spec.tone)),
            Background::Surface(source) => {
                let image = load(source, spec.seed ^ 0x5eed)?;
                let density = covering(&image, w + 2.0 * spec.pan, h + 2.0 * spec.pan);
                Some(Surface::new(&image, density, spec.defocus, spec.tone))
            }
        };
        let mut random = Random::new(spec.seed, STREAM_OCCLUDE);
        let mut coats: Vec<_> = texture::TEXTURES
            .iter()
            .filter(|t| spec.source != Source::Drawn(t.name) && t.name != "soft")
            .collect();
        let occluders = occlude::place(spec, &path, &mut random);
        let coat = |o: &Occluder| {
            let image = coats.swap_remove(random.below(coats.len())).draw(spec.seed);
            let density = covering(&image, 2.0 * o.half[0].max(4.0), 2.0 * o.half[1].max(4.0));
            Surface::new(&image, density, spec.soften, spec.tone)
        };
        let patches = occluders.iter().map(coat).collect();
        let rate = 0.6 / spec.frames as f64;
        Ok(Scene {
            pan: Curves::new(&mut Random::new(spec.seed, STREAM_PAN), spec.frames, rate),
            lighting: Lighting::new(spec, &mut Random::new(spec.seed, STREAM_LIGHT)),
            bend: (spec.bend > 0.0).then_some(Bend {
                bend: spec.bend,
                width: spec.object[0],
                frames: spec.frames,
            }),
            glare: Glare::new(spec, &mut Random::new(spec.seed, STREAM_GLARE)),
            exposure: exposure::factors(spec, &mut Random::new(spec.seed, STREAM_EXPOSURE)),
            twin: Twin::new(spec, &mut Random::new(spec.seed, STREAM_TWIN)),
            spec: spec.clone(),
            path,
            object,
            background,
            occluders,
            patches,
        })
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.spec.frames
    }

    /// Never true: a specification has at least one frame.
    pub fn is_empty(&self) -> bool {
        self.spec.frames == 0
    }

    /// Exact corners of the object in frame `i`, px.
    pub fn corners(&self, i: usize) -> Corners {
        let Some(bend) = self.bend else {
            return self.path.corners(i as f64);
        };
        let [w, h] = self.spec.object.map(|n| n / 2.0);
        Corners([[-w, -h], [w, -h], [w, h], [-w, h]].map(|m| self.place(bend, i, m)))
    }

    /// Where a point of the flat sheet is in frame `i`, px.
    fn place(&self, bend: Bend, i: usize, m: [f64; 2]) -> [f64; 2] {
        let t = i as f64;
        let q = bend.bent(bend.amount(t), m);
        homography::apply(&self.path.placed(t), q)
    }

    /// Where the points of a 10x10 grid on the object are in frame `i`, px, row by row; `None` when the corners tell all.
    pub fn dense_truth(&self, i: usize) -> Option<Vec<[f64; 2]>> {
        let bend = self.bend?;
        let at = |k: usize, n: f64| n * (k as f64 / (DENSE_SIDE - 1) as f64 - 0.5);
        let [w, h] = self.spec.object;
        let points = (0..DENSE_SIDE * DENSE_SIDE).map(|k| [at(k % DENSE_SIDE, w), at(k / DENSE_SIDE, h)]);
        Some(points.map(|m| self.place(bend, i, m)).collect())
    }

    /// Warp parameters of frame `i` and the centre (px) they refer to, see [`super::motion::warp`]; random walks have
    /// none.
    pub fn pose(&self, i: usize) -> Option<(Pose, [f64; 2])> {
        self.path.pose(i as f64).map(|p| (p, self.path.centre()))
    }

    /// Mean and greatest corner motion between successive frames, px.
    pub fn speed(&self) -> [f64; 2] {
        [self.path.mean_speed(self.len()), self.path.max_speed(self.len())]
    }

    /// Fraction of the object that lies in the image in frame `i`, covered or not, from a 48 x 48 grid over it.
    pub fn inside(&self, i: usize) -> f64 {
        const N: usize = 48;
        let placed = self.path.placed(i as f64);
        let at = |k: usize, n: f64| ((k as f64 + 0.5) / N as f64 - 0.5) * n;
        let [w, h] = self.spec.object;
        let seen = (0..N * N).filter(|k| {
            let p = project(&placed, [at(k % N, w), at(k / N, h)]);
            p.is_some_and(|p| (0..2).all(|c| (-0.5..=self.spec.size[c] as f64 - 0.5).contains(&p[c])))
        });
        seen.count() as f64 / (N * N) as f64
    }

    /// Fraction of the object covered by crossing patches in frame `i`.
    pub fn covered(&self, i: usize) -> f64 {
        occlude::covered(&self.occluders, &self.path, self.spec.object, i as f64)
    }

    /// Largest corner distance (px) in frame `i` to the nearest affine image of the first frame's corners.
    pub fn affine_misfit(&self, i: usize) -> f64 {
        affine_misfit(&self.corners(0), &self.corners(i))
    }

    /// All frames with their corners, in order.
    pub fn iter(&self) -> impl Iterator<Item = (RgbImage, Corners)> + '_ {
        (0..self.len()).map(|i| (self.frame(i), self.corners(i)))
    }

    /// Renders frame `i` (`i < len`).
    pub fn frame(&self, i: usize) -> RgbImage {
        let [width, height] = self.spec.size;
        let instants: Vec<Vec<Layer<'_>>> = self
            .instants(i as f64)
            .into_iter()
            .map(|t| self.layers(t))
            .collect();
        let samples = self.samples(&instants[0], instants.len());
        let light = self.lighting.as_ref().map(|l| l.at(i as f64));
        let object_only = self.lighting.as_ref().is_some_and(Lighting::object_only);
        let centre = self.path.corners(i as f64).centroid();
        let glare = self.glare.as_ref().map(|g| g.at(i as f64, centre));
        let exposure = self.exposure.get(i).copied();
        let mut image = RgbImage::new(width as u32, height as u32);
        image.par_chunks_mut(3 * width).enumerate().for_each(|(y, row)| {
            let stream = |first: u64| Random::new(self.spec.seed, first + (i * height + y) as u64);
            let mut noise = stream(STREAM_NOISE);
            let mut photons = stream(STREAM_PHOTONS);
            for (x, out) in row.chunks_exact_mut(3).enumerate() {
                let (mut colour, on_object) = pixel(&instants, x as f64, y as f64, samples);
                if let Some(light) = &light {
                    let (factor, bias) = light.local(x as f64, y as f64);
                    let share = if object_only { on_object } else { 1.0 };
                    colour = colour.map(|v| v + share * ((factor - 1.0) * v + bias));
                }
                if let Some(glare) = glare.as_ref().filter(|_| on_object > 0.0) {
                    let added = on_object * glare.local(x as f64, y as f64);
                    colour = colour.map(|v| v + added);
                }
                if let Some(factor) = exposure {
                    colour = colour.map(|v| factor * v);
                }
                let mut noise = if self.spec.noise > 0.0 {
                    self.spec.noise * noise.normal()
                } else {
                    0.0
                };
                if self.spec.photons > 0.0 {
                    noise += photons::noise(self.spec.photons, colour, &mut photons);
                }
                for (o, v) in out.iter_mut().zip(colour) {
                    *o = (v + noise).round().clamp(0.0, 255.0) as u8;
                }
            }
        });
        image
    }

    /// Times whose mean is frame `t`: one, or several over the exposure, at most about a pixel of motion apart.
    fn instants(&self, t: f64) -> Vec<f64> {
        let blur = if self.spec.mode == Mode::Independent {
            0.0
        } else {
            self.spec.blur
        };
        let reach = self
            .path
            .corners(t - blur / 2.0)
            .distance_squared(&self.path.corners(t + blur / 2.0))
            .sqrt();
        let n = if blur > 0.0 {
            (reach * 0.7).ceil().clamp(3.0, 24.0)
        } else {
            1.0
        };
        (0..n as usize)
            .map(|k| t + blur * ((k as f64 + 0.5) / n - 0.5))
            .collect()
    }

    /// Surfaces at time `t`, nearest first.
    fn layers<'a>(&'a self, t: f64) -> Vec<Layer<'a>> {
        let mut layers = Vec::with_capacity(5);
        let mut add = |surface: &'a Surface, placed: Mat3, half: Option<[f64; 2]>, object: bool| {
            let Some(sheet) = placed.try_inverse() else { return };
            let bend = self.bend.filter(|_| object).map(|b| (b, b.amount(t)));
            let room = bend.map_or(0.0, |(_, amount)| 2.0 * amount);
            let bounds = half.map_or([f64::MIN, f64::MIN, f64::MAX, f64::MAX], |h| {
                extent(&placed, h.map(|n| n + room))
            });
            let map = surface.to_texels * sheet;
            layers.push(Layer {
                surface,
                map,
                sheet,
                half,
                bend,
                bounds,
                object,
            });
        };
        for (o, patch) in self.occluders.iter().zip(&self.patches) {
            add(patch, o.placed(t), Some(o.half), false);
        }
        let half = self.spec.object.map(|n| n / 2.0 + self.spec.margin);
        let whole = self.spec.background == Background::Same;
        add(&self.object, self.path.placed(t), (!whole).then_some(half), true);
        if let Some(twin) = self.twin {
            let [x, y] = twin.offset(t);
            add(&self.object, shift(x, y) * self.path.placed(t), Some(half), false);
        }
        if let Some(background) = &self.background {
            let placed = if self.spec.background == Background::Still {
                self.path.placed(0.0)
            } else {
                let middle = self.spec.size.map(|n| (n as f64 - 1.0) / 2.0);
                let c = self.pan.at(t);
                shift(middle[0] + self.spec.pan * c[0], middle[1] + self.spec.pan * c[1])
            };
            add(background, placed, None, false);
        }
        layers
    }

    /// Samples per pixel side: at least 3 (2 with many instants), about one per texel where texels are densest, at
    /// most 8.
    fn samples(&self, layers: &[Layer<'_>], instants: usize) -> usize {
        let frame = self.spec.size.map(|n| n as f64 - 1.0);
        let mut most: f64 = if instants >= 4 { 2.0 } else { 3.0 };
        for layer in layers {
            let (x0, x1) = (layer.bounds[0].max(0.0), layer.bounds[2].min(frame[0]));
            let (y0, y1) = (layer.bounds[1].max(0.0), layer.bounds[3].min(frame[1]));
            for (x, y) in [(x0, y0), (x1, y0), (x1, y1), (x0, y1)] {
                let at = |dx: f64, dy: f64| project(&layer.map, [x + dx, y + dy]);
                if let (Some(a), Some(b), Some(c)) = (at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0)) {
                    most = most
                        .max(length(b[0] - a[0], b[1] - a[1]))
                        .max(length(c[0] - a[0], c[1] - a[1]));
                }
            }
        }
        most.ceil().min(8.0) as usize
    }
}

/// Bounding box in the frame of a sheet with half size `half`.
fn extent(placed: &Mat3, [w, h]: [f64; 2]) -> [f64; 4] {
    let mut b = [f64::MAX, f64::MAX, f64::MIN, f64::MIN];
    for p in [[-w, -h], [w, -h], [w, h], [-w, h]] {
        let Some([x, y]) = project(placed, p) else {
            return [f64::MIN, f64::MIN, f64::MAX, f64::MAX];
        };
        b = [b[0].min(x), b[1].min(y), b[2].max(x), b[3].max(y)];
    }
    b
}

/// Mean colour of pixel `(x, y)` over all instants and `n x n` samples, and the part of it that shows the object.
fn pixel(instants: &[Vec<Layer<'_>>], x: f64, y: f64, n: usize) -> ([f64; 3], f64) {
    let (mut sum, mut on_object) = ([0.0f64; 3], 0usize);
    for layers in instants {
        let near = |l: &Layer<'_>| {
            l.bounds[0] <= x + 0.5
                && x - 0.5 <= l.bounds[2]
                && l.bounds[1] <= y + 0.5
                && y - 0.5 <= l.bounds[3]
        };
        // The layers that this pixel may see, nearest first.
        let seen = layers
            .iter()
            .enumerate()
            .fold(0u64, |m, (k, l)| m | u64::from(near(l)) << k);
        for k in 0..n * n {
            let at = |i: usize, c: f64| c + (i as f64 + 0.5) / n as f64 - 0.5;
            let p = [at(k % n, x), at(k / n, y)];
            for (_, layer) in layers.iter().enumerate().filter(|(k, _)| seen >> k & 1 == 1) {
                let flat = || {
                    let q = project(&layer.sheet, p)?;
                    Some(layer.bend.map_or(q, |(bend, amount)| bend.flat(amount, q)))
                };
                let inside = layer.half.is_none_or(|half| {
                    flat().is_some_and(|s| s[0].abs() <= half[0] && s[1].abs() <= half[1])
                });
                if inside {
                    let texel = match layer.bend {
                        Some(_) => flat().and_then(|m| project(&layer.surface.to_texels, m)),
                        None => project(&layer.map, p),
                    };
                    // Behind the horizon of an endless plane there is nothing.
                    if let Some([u, v]) = texel {
                        let c = layer.surface.sample(u, v);
                        sum = [0, 1, 2].map(|k| sum[k] + f64::from(c[k]));
                        on_object += usize::from(layer.object);
                    }
                    break;
                }
            }
        }
    }
    let share = 1.0 / (n * n * instants.len()) as f64;
    (sum.map(|v| v * share), on_object as f64 * share)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A white sheet on black, so that coverage can be measured.
    fn white_sheet(change: &[(&str, &str)]) -> Scene {
        let mut spec = SynthSpec::default();
        for (k, v) in [
            ("tone", "255..255"),
            ("background", "black"),
            ("margin", "0"),
            ("frames", "8"),
        ] {
            spec.set(k, v).unwrap();
        }
        change.iter().for_each(|(k, v)| spec.set(k, v).unwrap());
        Scene::new(&spec).unwrap()
    }

    #[test]
    fn the_rendered_sheet_has_the_area_and_centre_of_its_corners() {
        let s = white_sheet(&[("speed", "6"), ("turn", "20"), ("lean", "0.2")]);
        for i in [0, 3, 7] {
            let (image, corners) = (s.frame(i), s.corners(i));
            let (mut mass, mut mx, mut my) = (0.0, 0.0, 0.0);
            for (x, y, p) in image.enumerate_pixels() {
                let v = f64::from(p[0]) / 255.0;
                (mass, mx, my) = (mass + v, mx + v * f64::from(x), my + v * f64::from(y));
            }
            assert!(
                (mass - corners.signed_area()).abs() < 0.003 * mass,
                "{mass} {}",
                corners.signed_area()
            );
            let centre = polygon_centre(&corners);
            assert!((mx / mass - centre[0]).abs() < 0.02 && (my / mass - centre[1]).abs() < 0.02);
        }
    }

    fn polygon_centre(c: &Corners) -> [f64; 2] {
        let (mut x, mut y) = (0.0, 0.0);
        for i in 0..4 {
            let (a, b) = (c.0[i], c.0[(i + 1) % 4]);
            let cross = a[0] * b[1] - b[0] * a[1];
            (x, y) = (x + (a[0] + b[0]) * cross, y + (a[1] + b[1]) * cross);
        }
        [x / 6.0 / c.signed_area(), y / 6.0 / c.signed_area()]
    }

    #[test]
    fn blur_keeps_the_centre_and_noise_has_its_sigma() {
        let sharp = white_sheet(&[("motion", "translation"), ("speed", "8")]);
        let blurred = white_sheet(&[("motion", "translation"), ("speed", "8"), ("blur", "1")]);
        let gray = |i: &RgbImage| i.pixels().filter(|p| p[0] > 10 && p[0] < 245).count();
        assert!(gray(&blurred.frame(4)) > gray(&sharp.frame(4)) + 100);
        let noisy = white_sheet(&[("tone", "120..120"), ("noise", "9")]).frame(0);
        let flat = (100..200).flat_map(|x| (90..150).map(move |y| (x, y)));
        let v: Vec<f64> = flat
            .map(|(x, y)| f64::from(noisy.get_pixel(x, y)[1]) - 120.0)
            .collect();
        let sigma = (v.iter().map(|v| v * v).sum::<f64>() / v.len() as f64).sqrt();
        assert!((sigma - 9.0).abs() < 0.4, "{sigma}");
    }

    #[test]
    fn light_on_the_object_alone_leaves_the_rest() {
        let mut spec = SynthSpec {
            frames: 12,
            background: Background::Surface(Source::Drawn("metal")),
            ..Default::default()
        };
        let plain = Scene::new(&spec).unwrap().frame(6);
        spec.set("light", "gain=0.5..1.5,bias=30,object").unwrap();
        let s = Scene::new(&spec).unwrap();
        let lit = s.frame(6);
        let centre = s.corners(6).centroid();
        assert_eq!(plain.get_pixel(2, 2), lit.get_pixel(2, 2));
        let inner = |i: &RgbImage| i.get_pixel(centre[0] as u32, centre[1] as u32)[0];
        assert_ne!(inner(&plain), inner(&lit));
    }
}
