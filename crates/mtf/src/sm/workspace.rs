//! Scratch of the search methods: borrowed per frame from a pool of the thread, so that thousands of trackers share a
//! few buffers and nothing is allocated once they have grown.

use crate::kernels::Jacobian;
use std::cell::RefCell;
use std::ops::{Deref, DerefMut};

/// Buffers for one patch. Contents are unspecified when taken.
#[derive(Debug, Default)]
pub struct Buffers {
    /// Current points in image pixels.
    pub x: Vec<f32>,
    /// Current points in image pixels.
    pub y: Vec<f32>,
    /// Raw values at the points, channel-planar.
    pub values: Vec<f32>,
    /// Image gradient at the points, channel-planar.
    pub gx: Vec<f32>,
    /// Image gradient at the points, channel-planar.
    pub gy: Vec<f32>,
    /// Values before they were lit; empty without an illumination model.
    pub raw: Vec<f32>,
    /// One number per value.
    pub scratch: Vec<f32>,
    /// Image Hessian `[Ixx, Ixy, Iyy]` at the points, channel-planar.
    pub hessian: [Vec<f32>; 3],
    /// Current Jacobian.
    pub j: Jacobian,
    /// For small solvers.
    pub work: Vec<f64>,
}

thread_local! {
    static POOL: RefCell<Vec<Buffers>> = const { RefCell::new(Vec::new()) };
}

/// A set of [`Buffers`] on loan from the thread's pool.
#[derive(Debug)]
pub struct Workspace(Option<Buffers>);

impl Workspace {
    /// Buffers for `points` points of `channels` channels and `dof` parameters.
    pub fn take(points: usize, channels: usize, dof: usize) -> Self {
        let mut b = POOL.with(|pool| pool.borrow_mut().pop()).unwrap_or_default();
        let n = points * channels;
        b.x.resize(points, 0.0);
        b.y.resize(points, 0.0);
        for buffer in [&mut b.values, &mut b.gx, &mut b.gy, &mut b.scratch] {
            buffer.resize(n, 0.0);
        }
        b.j.resize(n, dof);
        b.work.resize(dof * dof + dof, 0.0);
        Workspace(Some(b))
    }
}

impl Deref for Workspace {
    type Target = Buffers;
    fn deref(&self) -> &Buffers {
        self.0.as_ref().expect("held until dropped")
    }
}
impl DerefMut for Workspace {
    fn deref_mut(&mut self) -> &mut Buffers {
        self.0.as_mut().expect("held until dropped")
    }
}
impl Drop for Workspace {
    fn drop(&mut self) {
        if let Some(b) = self.0.take() {
            // Fails only while the thread ends, when there is no pool to return to.
            let _ = POOL.try_with(|pool| pool.borrow_mut().push(b));
        }
    }
}
