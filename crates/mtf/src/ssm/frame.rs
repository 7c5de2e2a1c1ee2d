//! The base frame that every model works in: origin, scale, corners and sampling grid at initialisation.

use super::Points;
use crate::geom::{Corners, Mat3, homography};
use crate::kernels;
use crate::params::Resolution;
use crate::tracker::TrackError;

/// Image coordinates moved to the centroid of the initial corners and divided by their RMS distance from it, with the
/// regular grid of the unit square mapped onto those corners by a homography.
#[derive(Clone, Debug)]
pub struct BaseFrame {
    /// Origin, px.
    pub centre: [f64; 2],
    /// Unit of length, px: the factor from pixels to the frame for image gradients, `∂I/∂(frame) = r ∂I/∂(pixel)`.
    pub radius: f64,
    /// Corners in the frame.
    pub corners: Corners,
    /// Homography from the square `[-0.5, 0.5]²` to the corners.
    pub from_square: Mat3,
    /// Grid points in the frame, row by row.
    pub x: Vec<f32>,
    /// Grid points in the frame, row by row.
    pub y: Vec<f32>,
    res: Option<Resolution>,
}

impl Default for BaseFrame {
    /// The square of unit RMS corner distance, without a grid.
    fn default() -> Self {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        BaseFrame {
            centre: [0.0; 2],
            radius: 1.0,
            corners: Corners::rect(-half, -half, 2.0 * half, 2.0 * half),
            from_square: Mat3::new(2.0 * half, 0.0, 0.0, 0.0, 2.0 * half, 0.0, 0.0, 0.0, 1.0),
            x: Vec::new(),
            y: Vec::new(),
            res: None,
        }
    }
}

impl BaseFrame {
    /// Frame and grid of `corners`. Fails unless they are a convex quadrilateral of at least 1 px².
    pub fn set(&mut self, corners: &Corners, res: Resolution) -> Result<(), TrackError> {
        if !corners.is_finite() {
            return Err(TrackError::NotFinite("corners"));
        }
        if !corners.is_convex() {
            return Err(TrackError::BadRegion("corners are not a convex quadrilateral"));
        }
        if corners.signed_area().abs() < 1.0 {
            return Err(TrackError::BadRegion("region is smaller than one pixel"));
        }
        let [cx, cy] = corners.centroid();
        let spread: f64 = corners
            .0
            .iter()
            .map(|[x, y]| (x - cx).powi(2) + (y - cy).powi(2))
            .sum();
        self.centre = [cx, cy];
        self.radius = (spread / 4.0).sqrt();
        self.corners = self.to_frame(corners);
        let square = Corners::rect(-0.5, -0.5, 1.0, 1.0);
        self.from_square = homography::from_corners(&square, &self.corners)
            .ok_or(TrackError::BadRegion("corners are not a convex quadrilateral"))?;
        self.x.resize(res.len(), 0.0);
        self.y.resize(res.len(), 0.0);
        let m = std::array::from_fn(|i| self.from_square[(i / 3, i % 3)] as f32);
        kernels::regular_grid(&m, res.cols, res.rows, &mut self.x, &mut self.y);
        self.res = Some(res);
        Ok(())
    }

    /// Corners in image pixels.
    pub fn corners_in_image(&self) -> Corners {
        self.to_image(&self.corners)
    }

    /// Grid points in the frame.
    pub fn grid(&self) -> Points<'_> {
        Points {
            x: &self.x,
            y: &self.y,
        }
    }

    /// Sampling grid; `None` before [`set`](Self::set).
    pub fn res(&self) -> Option<Resolution> {
        self.res
    }

    /// A point in image pixels as one of the frame.
    pub fn point_to_frame(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [
            (x - self.centre[0]) / self.radius,
            (y - self.centre[1]) / self.radius,
        ]
    }

    /// A point of the frame in image pixels.
    pub fn point_to_image(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.centre[0] + self.radius * x, self.centre[1] + self.radius * y]
    }

    /// Corners in image pixels as those of the frame.
    pub fn to_frame(&self, c: &Corners) -> Corners {
        Corners(c.0.map(|p| self.point_to_frame(p)))
    }

    /// Corners of the frame in image pixels.
    pub fn to_image(&self, c: &Corners) -> Corners {
        Corners(c.0.map(|p| self.point_to_image(p)))
    }

    /// A matrix that acts on pixels as one that acts on the frame.
    pub fn matrix_to_frame(&self, m: &Mat3) -> Mat3 {
        let ([cx, cy], r) = (self.centre, self.radius);
        let to_image = Mat3::new(r, 0.0, cx, 0.0, r, cy, 0.0, 0.0, 1.0);
        let to_frame = Mat3::new(1.0 / r, 0.0, -cx / r, 0.0, 1.0 / r, -cy / r, 0.0, 0.0, 1.0);
        to_frame * m * to_image
    }

    /// Grid point `i` in `f64`.
    pub fn grid_point(&self, i: usize) -> [f64; 2] {
        [self.x[i].into(), self.y[i].into()]
    }

    /// Refuses warped corners (in the frame) that are no sound region: convex, of the base's orientation, 1 px² at least.
    pub fn check(&self, warped: &Corners) -> Result<(), TrackError> {
        if !warped.is_finite() {
            return Err(TrackError::NotFinite("corners"));
        }
        if !warped.is_convex() || warped.signed_area() * self.corners.signed_area() <= 0.0 {
            return Err(TrackError::Degenerate("region is not convex"));
        }
        if warped.signed_area().abs() * self.radius * self.radius < 1.0 {
            return Err(TrackError::Degenerate("region is smaller than one pixel"));
        }
        Ok(())
    }

    /// The frame of `corners` with the same grid, and the homography from it to this one.
    pub fn rebased(&self, corners: &Corners) -> Result<(BaseFrame, Mat3), TrackError> {
        let res = self.res.ok_or(TrackError::NotInitialised)?;
        let mut fresh = BaseFrame::default();
        fresh.set(corners, res)?;
        let carry = homography::from_corners(&fresh.corners, &self.corners)
            .ok_or(TrackError::BadRegion("corners are not a convex quadrilateral"))?;
        Ok((fresh, carry))
    }

    /// Bytes of the grid.
    pub fn memory(&self) -> usize {
        8 * self.x.capacity()
    }
}
