//! System functions of benches: a counting allocator, CPU time.
#![allow(unsafe_code, reason = "an allocator cannot be written without")]
#![allow(clippy::disallowed_methods, reason = "a bench asks for its CPU time")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// System allocator with a count of its calls, and of the bytes in use.
pub struct Counting {
    allocations: AtomicU64,
    bytes: AtomicU64,
    most: AtomicU64,
}

impl Counting {
    pub const fn new() -> Self {
        Self { allocations: AtomicU64::new(0), bytes: AtomicU64::new(0), most: AtomicU64::new(0) }
    }

    /// Number of allocations since the start, including reallocations.
    pub fn allocations(&self) -> u64 {
        self.allocations.load(Relaxed)
    }

    /// Bytes in use.
    #[allow(dead_code, reason = "not every bench measures memory")]
    pub fn bytes(&self) -> u64 {
        self.bytes.load(Relaxed)
    }

    /// Largest number of bytes in use since the last call, or since the start.
    #[allow(dead_code, reason = "not every bench measures memory")]
    pub fn take_most(&self) -> u64 {
        self.most.swap(self.bytes(), Relaxed)
    }

    fn grow(&self, size: usize) {
        self.allocations.fetch_add(1, Relaxed);
        let bytes = self.bytes.fetch_add(size as u64, Relaxed) + size as u64;
        self.most.fetch_max(bytes, Relaxed);
    }

    fn shrink(&self, size: usize) {
        self.bytes.fetch_sub(size as u64, Relaxed);
    }
}

// SAFETY: every call is passed to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        self.grow(layout.size());
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        self.shrink(layout.size());
        // SAFETY: the caller's promise is passed on; `pointer` came from there.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // Old and new block may exist together.
        self.grow(size);
        self.shrink(layout.size());
        // SAFETY: the caller's promise is passed on; `pointer` came from there.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

/// CPU time of this thread, ns (kernel: Documentation/scheduler/sched-stats.rst).
pub fn cpu_ns() -> u64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").expect("a kernel with schedstat");
    text.split_whitespace().next().and_then(|ns| ns.parse().ok()).expect("nanoseconds")
}
