//! An allocator that counts: how many bytes are taken, the most that were, and a bound above which it gives none.
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

/// More than any input may take, and less than what would make the machine swap: an input that asks for more ends its process.
const BOUND: usize = 2 << 30;

static TAKEN: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);

pub struct Counting;

/// Note that `size` more bytes are wanted; whether they are within the bound.
fn take(size: usize) -> bool {
    let now = TAKEN.fetch_add(size, Ordering::Relaxed).saturating_add(size);
    MOST.fetch_max(now, Ordering::Relaxed);
    if now > BOUND {
        TAKEN.fetch_sub(size, Ordering::Relaxed);
    }
    now <= BOUND
}

// SAFETY: all is left to the system's allocator, but for requests that are refused.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as the caller promises.
        if take(layout.size()) { unsafe { System.alloc(layout) } } else { std::ptr::null_mut() }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as the caller promises.
        if take(layout.size()) { unsafe { System.alloc_zeroed(layout) } } else { std::ptr::null_mut() }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        TAKEN.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        if !take(size) {
            return std::ptr::null_mut();
        }
        // SAFETY: as the caller promises.
        let moved = unsafe { System.realloc(pointer, layout, size) };
        TAKEN.fetch_sub(if moved.is_null() { size } else { layout.size() }, Ordering::Relaxed);
        moved
    }
}

/// Keeps other tests of the process from taking memory meanwhile: each that looks at [`peak`] holds it from its beginning.
#[allow(dead_code)] // Of two programs that count, each uses a part.
pub fn alone() -> std::sync::MutexGuard<'static, ()> {
    static ALONE: std::sync::Mutex<()> = std::sync::Mutex::new(());
    ALONE.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

#[allow(dead_code)]
/// The most bytes that were taken while `f` ran, above those that were taken before.
pub fn peak<T>(f: impl FnOnce() -> T) -> (T, usize) {
    let before = TAKEN.load(Ordering::Relaxed);
    MOST.store(before, Ordering::Relaxed);
    let result = f();
    (result, MOST.load(Ordering::Relaxed).saturating_sub(before))
}

/// The bytes that are taken now.
#[allow(dead_code)] // Of two programs that count, each uses a part.
pub fn taken() -> usize {
    TAKEN.load(Ordering::Relaxed)
}
