//! The end of memory: one line and the exit code of a run that was stopped, in place of an abort.

use std::alloc::{GlobalAlloc, Layout, System};
use std::io::Write;

/// The system's allocator, which ends the process in order when there is no more. Nothing finished is lost: a unit is in
/// the journal as soon as it ends.
pub struct Checked;

// SAFETY: every call is handed to the system's allocator as it is, and what that returns is returned unless it is null.
unsafe impl GlobalAlloc for Checked {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller keeps the contract of this function, which is the same.
        checked(unsafe { System.alloc(layout) }, layout.size())
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as above.
        checked(unsafe { System.alloc_zeroed(layout) }, layout.size())
    }
    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: as above.
        checked(unsafe { System.realloc(block, layout, size) }, size)
    }
    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(block, layout) }
    }
}

fn checked(block: *mut u8, size: usize) -> *mut u8 {
    if block.is_null() {
        end(size);
    }
    block
}

/// Says so without allocating and ends the process.
#[cold]
fn end(size: usize) -> ! {
    let mut line = [0; 160];
    let mut rest = &mut line[..];
    let _ = writeln!(
        rest,
        "error: out of memory ({size} bytes more cannot be had): nothing finished is lost; use fewer threads (-j) or less --memory"
    );
    let free = rest.len();
    let _ = std::io::stderr().write_all(&line[..160 - free]);
    mtf_eval::cli::end_for_lack_of_memory()
}
