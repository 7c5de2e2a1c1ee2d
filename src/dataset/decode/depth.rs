//! How 16 bits per channel become 8.

use image::DynamicImage;
use std::fmt;
use std::str::FromStr;

/// The rule by which 16 bits per channel become 8. Other images are not touched.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Depth16 {
    /// 0..=65535 to 0..=255: `v / 257`, rounded.
    #[default]
    Scale,
    /// The least value of each image to 0 and its greatest to 255, over all channels; others in proportion, rounded.
    MinMax,
    /// `v >> n`, at most 255: of data with 8 + n bits.
    Shift(u32),
}

impl Depth16 {
    /// Applies the rule to an image of 16 bits per channel; the result has 16 bits that [`Scale`](Depth16::Scale) brings to
    /// what the rule says.
    pub(super) fn apply(self, image: &mut DynamicImage) {
        let values: &mut [u16] = match image {
            DynamicImage::ImageLuma16(image) => image,
            DynamicImage::ImageLumaA16(image) => image,
            DynamicImage::ImageRgb16(image) => image,
            DynamicImage::ImageRgba16(image) => image,
            _ => return,
        };
        match self {
            Depth16::Scale => {}
            Depth16::MinMax => {
                let least = values.iter().copied().min().unwrap_or(0);
                let range = u32::from(values.iter().copied().max().unwrap_or(0) - least).max(1);
                for v in values {
                    let level = (255 * u32::from(*v - least) + range / 2) / range;
                    *v = 257 * level as u16;
                }
            }
            Depth16::Shift(n) => values.iter_mut().for_each(|v| *v = 257 * (*v >> n).min(255)),
        }
    }
}

impl fmt::Display for Depth16 {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Depth16::Scale => f.write_str("scale"),
            Depth16::MinMax => f.write_str("minmax"),
            Depth16::Shift(n) => write!(f, "shift:{n}"),
        }
    }
}

impl FromStr for Depth16 {
    type Err = String;

    fn from_str(text: &str) -> Result<Depth16, String> {
        let bits = |n: &str| n.parse().ok().filter(|n| *n <= 8).map(Depth16::Shift);
        match (text, text.strip_prefix("shift:")) {
            ("scale", _) => Ok(Depth16::Scale),
            ("minmax", _) => Ok(Depth16::MinMax),
            (_, Some(n)) => {
                bits(n).ok_or_else(|| format!("shift:{n}: expected a number of bits from 0 to 8"))
            }
            _ => Err(format!("'{text}': expected scale, minmax or shift:N")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn levels(rule: &str, values: &[u16]) -> Vec<u8> {
        let image =
            image::ImageBuffer::<image::Luma<u16>, _>::from_raw(values.len() as u32, 1, values.to_vec());
        let mut image = DynamicImage::from(image.unwrap());
        rule.parse::<Depth16>().unwrap().apply(&mut image);
        image.into_luma8().into_raw()
    }

    #[test]
    fn rules_are_what_they_say() {
        assert_eq!(levels("scale", &[0, 257, 32_896, 65_535]), [0, 1, 128, 255]);
        assert_eq!(levels("minmax", &[51_241, 51_711, 52_181]), [0, 128, 255]);
        assert_eq!(levels("minmax", &[7, 7]), [0, 0]);
        assert_eq!(levels("shift:4", &[0, 16, 4095, 5000]), [0, 1, 255, 255]);
        for rule in ["scale", "minmax", "shift:2"] {
            assert_eq!(rule.parse::<Depth16>().unwrap().to_string(), rule);
        }
        for wrong in ["", "shift", "shift:", "shift:9", "shift:-1", "16"] {
            assert!(wrong.parse::<Depth16>().is_err(), "{wrong}");
        }
    }
}
