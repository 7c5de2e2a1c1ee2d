//! Jacobians as struct of arrays.

use super::WIDTH;

/// N x S matrix of `f32` in column-major order (struct of arrays): a row per patch value, a column per parameter.
///
/// Element `(i, k)` is the derivative of value `i` of a patch with respect to parameter `k` of a warp, or of an illumination
/// model. State space models and illumination models write columns; appearance models read them.
#[derive(Clone, Debug, Default)]
pub struct Jacobian {
    pub(super) rows: usize,
    pub(super) cols: usize,
    /// Elements between the starts of two columns, whole lanes.
    pub(super) stride: usize,
    pub(super) data: Vec<f32>,
}

impl Jacobian {
    /// Zero matrix.
    pub fn new(rows: usize, cols: usize) -> Self {
        let mut j = Jacobian::default();
        j.resize(rows, cols);
        j
    }
    /// Changes the shape; contents are unspecified afterwards. Allocates only when it grows.
    pub fn resize(&mut self, rows: usize, cols: usize) {
        self.rows = rows;
        self.cols = cols;
        self.stride = rows.next_multiple_of(WIDTH);
        self.data.resize(self.stride * cols, 0.0);
    }
    /// Number of values N.
    pub fn rows(&self) -> usize {
        self.rows
    }
    /// Number of parameters S.
    pub fn cols(&self) -> usize {
        self.cols
    }
    /// Column of parameter `k`, length N.
    pub fn col(&self, k: usize) -> &[f32] {
        &self.data[k * self.stride..][..self.rows]
    }
    /// Column of parameter `k`, mutable.
    pub fn col_mut(&mut self, k: usize) -> &mut [f32] {
        &mut self.data[k * self.stride..][..self.rows]
    }
    /// Bytes of storage.
    pub fn memory(&self) -> usize {
        self.data.capacity() * size_of::<f32>()
    }
    /// Copies `other`. Allocates only when it grows.
    pub fn copy_from(&mut self, other: &Jacobian) {
        self.resize(other.rows, other.cols);
        self.data.copy_from_slice(&other.data);
    }
    /// `self = (self + other) / 2`.
    pub fn average_with(&mut self, other: &Jacobian) {
        debug_assert_eq!((self.rows, self.cols), (other.rows, other.cols));
        for (a, b) in self.data.iter_mut().zip(&other.data) {
            *a = 0.5 * (*a + b);
        }
    }
}

/// Same shape and same elements.
impl PartialEq for Jacobian {
    fn eq(&self, other: &Self) -> bool {
        (self.rows, self.cols) == (other.rows, other.cols)
            && (0..self.cols).all(|k| self.col(k) == other.col(k))
    }
}
