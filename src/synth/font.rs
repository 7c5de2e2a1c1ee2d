//! A small stroke font of the project's own, for printed textures.
//!
//! A glyph is a list of strokes; a stroke is a list of points, two digits each (x, y), on a grid with the cap line at
//! y = 0, the x-height at y = 2, the base line at y = 6 and descenders down to y = 8.

use super::canvas::{Canvas, Colour};

/// Height of a capital in grid units.
const CAP: f64 = 6.0;

#[rustfmt::skip]
const GLYPHS: &[(char, &str)] = &[
    ('A', "06 20 46,14 34"), ('B', "00 06 36 45 44 33 03,00 30 41 42 33"), ('C', "41 30 10 01 05 16 36 45"),
    ('D', "00 06 26 44 42 20 00"), ('E', "40 00 06 46,03 33"), ('F', "40 00 06,03 33"),
    ('G', "41 30 10 01 05 16 36 45 43 23"), ('H', "00 06,40 46,03 43"), ('I', "10 30,20 26,16 36"),
    ('J', "40 45 36 16 05"), ('K', "00 06,40 03 46"), ('L', "00 06 46"), ('M', "06 00 23 40 46"),
    ('N', "06 00 46 40"), ('O', "10 30 41 45 36 16 05 01 10"), ('P', "06 00 30 41 42 33 03"),
    ('Q', "10 30 41 45 36 16 05 01 10,34 47"), ('R', "06 00 30 41 42 33 03,23 46"),
    ('S', "41 30 10 01 02 13 33 44 45 36 16 05"), ('T', "00 40,20 26"), ('U', "00 05 16 36 45 40"),
    ('V', "00 26 40"), ('W', "00 16 23 36 40"), ('X', "00 46,40 06"), ('Y', "00 23 40,23 26"),
    ('Z', "00 40 06 46"),
    ('a', "12 22 33 36,34 14 05 16 26 35"), ('b', "00 06,03 12 22 33 35 26 16 05"), ('c', "33 22 12 03 05 16 26 35"),
    ('d', "30 36,33 22 12 03 05 16 26 35"), ('e', "04 34 33 22 12 03 05 16 26"), ('f', "30 20 11 16,03 23"),
    ('g', "32 37 28 18,33 22 12 03 05 16 26 35"), ('h', "00 06,03 12 22 33 36"), ('i', "12 16,10 10"),
    ('j', "22 27 18 08,20 20"), ('k', "00 06,32 04 36"), ('l', "10 15 26"), ('m', "02 06,03 12 23 26,23 32 43 46"),
    ('n', "02 06,03 12 22 33 36"), ('o', "12 22 33 35 26 16 05 03 12"), ('p', "02 08,03 12 22 33 35 26 16 05"),
    ('q', "32 38,33 22 12 03 05 16 26 35"), ('r', "02 06,04 13 22 32"), ('s', "32 12 03 14 24 35 26 06"),
    ('t', "10 15 26,02 22"), ('u', "02 05 16 26 35,32 36"), ('v', "02 16 32"), ('w', "02 16 23 36 42"),
    ('x', "02 36,32 06"), ('y', "02 15,32 08"), ('z', "02 32 06 36"),
    ('0', "10 30 41 45 36 16 05 01 10,14 32"), ('1', "11 20 26,16 36"), ('2', "01 10 30 41 42 06 46"),
    ('3', "00 40 22 32 43 45 36 16 05"), ('4', "36 30 04 44"), ('5', "40 00 02 32 43 45 36 06"),
    ('6', "40 20 02 05 16 36 45 44 33 03"), ('7', "00 40 16"), ('8', "13 02 01 10 30 41 42 33 13 04 05 16 36 45 44 33"),
    ('9', "43 13 02 01 10 30 41 44 26 06"), ('.', "06 06"), (',', "16 07"), ('-', "04 24"), (':', "03 03,06 06"),
    ('/', "06 30"), ('!', "10 14,16 16"), ('?', "01 10 20 31 32 14,16 16"), ('(', "20 02 04 26"), (')', "00 22 24 06"),
    ('+', "04 44,22 26"), ('=', "03 33,05 35"), ('%', "06 40,01 01,45 45"), ('&', "46 12 11 20 31 04 05 16 26 44"),
];

fn strokes(c: char) -> Option<Vec<Vec<[f64; 2]>>> {
    let (_, text) = GLYPHS.iter().find(|(g, _)| *g == c)?;
    let point = |p: &str| {
        let b = p.as_bytes();
        [f64::from(b[0] - b'0'), f64::from(b[1] - b'0')]
    };
    Some(
        text.split(',')
            .map(|s| s.split(' ').map(point).collect())
            .collect(),
    )
}

/// Distance from one letter's start to the next one's, in grid units (a blank for unknown characters).
fn advance(c: char) -> f64 {
    strokes(c).map_or(2.5, |s| {
        s.iter().flatten().map(|p| p[0]).fold(0.0, f64::max) + 1.9
    })
}

/// Width of `text` in texels, set in capitals `size` texels high.
pub(crate) fn text_width(text: &str, size: f64) -> f64 {
    (text.chars().map(advance).sum::<f64>() - 1.9).max(0.0) * size / CAP
}

/// How a text is set.
#[derive(Clone, Copy)]
pub(crate) struct Style {
    /// Height of a capital, texels.
    pub size: f64,
    /// Stroke thickness as a fraction of `size`.
    pub weight: f64,
    /// Ink.
    pub colour: Colour,
    /// Direction of the base line, degrees clockwise.
    pub turn: f64,
}

/// Draws `text` with the left end of its cap line at `(x, y)`.
pub(crate) fn draw_text(canvas: &mut Canvas, x: f64, y: f64, text: &str, style: Style) {
    let (sin, cos) = libm::sincos(style.turn.to_radians());
    let scale = style.size / CAP;
    let mut pen = 0.0;
    for c in text.chars() {
        for stroke in strokes(c).unwrap_or_default() {
            let place = |p: &[f64; 2]| {
                let (u, v) = ((pen + p[0]) * scale, p[1] * scale);
                [x + cos * u - sin * v, y + sin * u + cos * v]
            };
            let points: Vec<_> = stroke.iter().map(place).collect();
            canvas.line(&points, style.weight * style.size, style.colour, 1.0);
        }
        pen += advance(c);
    }
}

/// Words for running text.
#[rustfmt::skip]
pub(crate) const WORDS: &[&str] = &[
    "the", "plane", "moves", "under", "light", "and", "every", "corner", "keeps", "its", "place", "a", "template",
    "follows", "frame", "by", "slowly", "warped", "image", "of", "small", "patches", "gradient", "descent", "finds",
    "similar", "when", "noise", "is", "weak", "we", "measure", "error", "in", "pixels", "over", "long", "sequences",
    "with", "known", "motion", "scale", "tilt", "or", "shadow", "each", "step", "solves", "linear", "system", "until",
    "update", "below", "limit", "texture", "gives", "shape", "to", "surface", "where", "edges", "meet", "(see", "fig",
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_letters_and_digits_have_strokes() {
        for c in ('A'..='Z').chain('a'..='z').chain('0'..='9') {
            let s = strokes(c).unwrap_or_else(|| panic!("no glyph for {c}"));
            assert!(s.iter().all(|stroke| stroke.len() >= 2), "{c}");
        }
        assert!(text_width("MM", 12.0) > text_width("ii", 12.0));
    }
}
