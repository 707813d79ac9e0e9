//! Values that always take the same number of bytes.

use core::array;

/// A value that always takes [`SIZE`](Self::SIZE) bytes: numbers, booleans, arrays of fixed length of such, and structs
/// of nothing else. Any such bytes are a value, so loading cannot fail.
pub trait Fixed: Sized {
    /// Maximum number of bytes it takes.
    const SIZE: usize;

    /// Stores it; `out` is `SIZE` bytes long.
    fn store(&self, out: &mut [u8]);

    /// Loads it; `bytes` are `SIZE` long.
    fn load(bytes: &[u8]) -> Self;
}

macro_rules! numbers {
    ($($number:ty)*) => {$(
        impl Fixed for $number {
            const SIZE: usize = size_of::<Self>();

            #[inline]
            fn store(&self, out: &mut [u8]) {
                out.copy_from_slice(&self.to_be_bytes());
            }

            #[inline]
            fn load(bytes: &[u8]) -> Self {
                let mut own = [0; size_of::<Self>()];
                own.copy_from_slice(bytes);
                Self::from_be_bytes(own)
            }
        }
    )*};
}

numbers! { i8 i16 i32 i64 u8 f32 f64 }

/// Written as 0 or 1; any other byte reads as true, as in the official Python module.
impl Fixed for bool {
    const SIZE: usize = 1;

    #[inline]
    fn store(&self, out: &mut [u8]) {
        u8::from(*self).store(out);
    }

    #[inline]
    fn load(bytes: &[u8]) -> Self {
        u8::load(bytes) != 0
    }
}

impl<T: Fixed, const N: usize> Fixed for [T; N] {
    const SIZE: usize = N * T::SIZE;

    #[inline]
    fn store(&self, out: &mut [u8]) {
        store_all(self, out);
    }

    #[inline]
    fn load(bytes: &[u8]) -> Self {
        array::from_fn(|i| T::load(&bytes[i * T::SIZE..(i + 1) * T::SIZE]))
    }
}

/// Stores the values one after the other; `out` is exactly as long as they are.
#[inline]
pub(super) fn store_all<T: Fixed>(values: &[T], out: &mut [u8]) {
    if T::SIZE > 0 {
        for (value, out) in values.iter().zip(out.chunks_exact_mut(T::SIZE)) {
            value.store(out);
        }
    }
}
