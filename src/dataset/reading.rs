//! How the numbers of ground truth become corners: where the first pixel is, what the four numbers of a box are, and which
//! frames rows are for.
//!
//! Depends on `geom` alone.

use mtf::geom::Corners;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// The form of a box.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BoxForm {
    /// Upper left corner, width and height: `x y w h`.
    #[default]
    Xywh,
    /// Upper left and lower right corner: `x1 y1 x2 y2`.
    Xyxy,
    /// Centre, width and height: `cx cy w h`.
    Cxcywh,
}

impl BoxForm {
    /// All forms.
    pub const ALL: [BoxForm; 3] = [BoxForm::Xywh, BoxForm::Xyxy, BoxForm::Cxcywh];

    /// The box of the four numbers `v`, px, pixel centres at integers. A negative extent is no extent: such a box has no
    /// area. NaN stays NaN.
    pub fn corners(self, v: &[f64], origin: Origin) -> Corners {
        let extent = |e: f64| if e < 0.0 { 0.0 } else { e };
        let [x, y] = [v[0] - origin.0, v[1] - origin.0];
        let (width, height) = match self {
            BoxForm::Xyxy => (extent(v[2] - v[0]), extent(v[3] - v[1])),
            BoxForm::Xywh | BoxForm::Cxcywh => (extent(v[2]), extent(v[3])),
        };
        match self {
            BoxForm::Cxcywh => Corners::rect(x - width / 2.0, y - height / 2.0, width, height),
            BoxForm::Xywh | BoxForm::Xyxy => Corners::rect(x, y, width, height),
        }
    }
}

impl fmt::Display for BoxForm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            BoxForm::Xywh => "xywh",
            BoxForm::Xyxy => "xyxy",
            BoxForm::Cxcywh => "cxcywh",
        })
    }
}

impl FromStr for BoxForm {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let named = BoxForm::ALL.into_iter().find(|form| form.to_string() == text);
        named.ok_or_else(|| format!("`{text}`: expected xywh, xyxy or cxcywh"))
    }
}

/// The coordinate, of x and y alike, that the data gives to the centre of its first pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "f64", into = "f64")]
pub struct Origin(f64);

impl Origin {
    /// Pixel centres at integers, counted from 0: 0.
    pub const CENTRE: Origin = Origin(0.0);
    /// The outer corner of the first pixel is at 0: 0.5.
    pub const CORNER: Origin = Origin(0.5);
    /// What there is: as the two others, or the same counted from 1.
    pub const ALL: [Origin; 4] = [Origin::CENTRE, Origin::CORNER, Origin(1.0), Origin(1.5)];

    /// The coordinate, px.
    pub fn value(self) -> f64 {
        self.0
    }

    /// The corners of eight numbers `v`, px, pixel centres at integers from 0.
    pub fn corners(self, v: &[f64]) -> Corners {
        let at = |i: usize| [v[i] - self.0, v[i + 1] - self.0];
        Corners([at(0), at(2), at(4), at(6)])
    }
}

impl TryFrom<f64> for Origin {
    type Error = String;

    fn try_from(value: f64) -> Result<Self, String> {
        let known = Origin::ALL.into_iter().find(|origin| origin.0 == value);
        known.ok_or_else(|| format!("origin {value}: expected 0, 0.5, 1 or 1.5"))
    }
}

impl From<Origin> for f64 {
    fn from(origin: Origin) -> f64 {
        origin.0
    }
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl FromStr for Origin {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let value: f64 = text
            .parse()
            .map_err(|_| format!("`{text}`: expected 0, 0.5, 1 or 1.5"))?;
        Origin::try_from(value)
    }
}

/// Which frames the rows of ground truth are for that name none, where it is not a row for each frame in order. Frames are
/// meant by the numbers in their names or, where names have none, by their place from 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TruthRows {
    /// Number of the frame that the first row is for; `None`: the first frame's.
    pub start: Option<u64>,
    /// From the frame of a row to that of the next; `None`: 1.
    pub step: Option<u64>,
}

impl TruthRows {
    /// What is said here, else there.
    pub fn or(self, other: TruthRows) -> TruthRows {
        TruthRows {
            start: self.start.or(other.start),
            step: self.step.or(other.step),
        }
    }

    /// Whether anything is said.
    pub(super) fn is_given(self) -> bool {
        self != TruthRows::default()
    }
}

/// What is asked for in place of what a format usually has.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reading {
    /// Where the first pixel is.
    pub origin: Option<Origin>,
    /// What the numbers of boxes are.
    pub boxes: Option<BoxForm>,
    /// Which frames rows are for that name none.
    pub rows: TruthRows,
    /// Masks, and polygons of more than four points, are read as the smallest rectangle around them.
    pub fit_masks: bool,
}

impl Reading {
    /// What is asked for here, else there.
    pub fn or(self, other: Reading) -> Reading {
        Reading {
            origin: self.origin.or(other.origin),
            boxes: self.boxes.or(other.boxes),
            rows: self.rows.or(other.rows),
            fit_masks: self.fit_masks || other.fit_masks,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forms_of_boxes() {
        let expected = Corners::rect(9.5, 19.5, 30.0, 40.0);
        for (form, numbers) in [
            ("xywh", [10.0, 20.0, 30.0, 40.0]),
            ("xyxy", [10.0, 20.0, 40.0, 60.0]),
            ("cxcywh", [25.0, 40.0, 30.0, 40.0]),
        ] {
            let form: BoxForm = form.parse().unwrap();
            assert_eq!(form.corners(&numbers, Origin::CORNER), expected, "{form}");
            let from_one = numbers.map(|v| v + 1.0);
            let from_one = match form {
                BoxForm::Xyxy => from_one,
                BoxForm::Xywh | BoxForm::Cxcywh => [from_one[0], from_one[1], numbers[2], numbers[3]],
            };
            assert_eq!(
                form.corners(&from_one, "1.5".parse().unwrap()),
                expected,
                "{form}"
            );
        }
        assert!("xy".parse::<BoxForm>().is_err());
    }

    #[test]
    fn origins() {
        let quad = [2.0, 3.0, 12.0, 3.0, 12.0, 9.0, 2.0, 9.0];
        for (text, shift) in [("0", 0.0), ("0.5", -0.5), ("1", -1.0), ("1.5", -1.5)] {
            let origin: Origin = text.parse().unwrap();
            assert_eq!(
                origin.corners(&quad),
                Corners::from_array(quad).translated(shift, shift)
            );
            assert_eq!((origin.to_string(), origin.value()), (text.to_string(), -shift));
        }
        for bad in ["2", "-0.5", "x", "nan"] {
            assert!(bad.parse::<Origin>().is_err(), "{bad}");
        }
    }
}
