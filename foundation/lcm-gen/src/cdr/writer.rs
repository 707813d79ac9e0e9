//! CDR writer for single values.

/// Appends one message as little-endian CDR: each number is aligned to its size, counted from the end of the header.
///
/// For messages without a `.lcm` file: fields are written in order; a struct is written as its fields, an array of
/// fixed size as its elements, a sequence as its [`count`](Self::count) and its elements.
#[derive(Debug)]
pub struct Writer<'a> {
    pub(super) out: &'a mut Vec<u8>,
    /// Offset from which alignment counts.
    start: usize,
}

macro_rules! numbers {
    ($($ty:ident)*) => {$(
        #[doc = concat!("Appends an `", stringify!($ty), "`.")]
        #[inline]
        pub fn $ty(&mut self, value: $ty) {
            self.align(size_of::<$ty>());
            self.out.extend_from_slice(&value.to_le_bytes());
        }
    )*};
}

impl<'a> Writer<'a> {
    /// Begins a message after the content of `out`.
    pub fn new(out: &'a mut Vec<u8>) -> Self {
        out.extend_from_slice(&[0, 1, 0, 0]);
        let start = out.len();
        Self { out, start }
    }

    /// Bytes written since the header.
    #[must_use]
    pub fn len(&self) -> usize {
        self.out.len() - self.start
    }

    /// True if only the header was written.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    numbers!(u8 i8 u16 i16 i32 u32 i64 f32 f64);

    /// Appends a `bool`.
    pub fn bool(&mut self, value: bool) {
        self.u8(value.into());
    }

    /// Appends a `string`, up to the first NUL, which would end it for every reader.
    pub fn string(&mut self, text: &str) {
        let text = text.split('\0').next().unwrap_or_default();
        self.count(text.len() + 1);
        self.out.extend_from_slice(text.as_bytes());
        self.out.push(0);
    }

    /// Appends the number of elements of a sequence, or of bytes of a string.
    #[inline]
    pub fn count(&mut self, count: usize) {
        self.u32(u32::try_from(count).unwrap_or(u32::MAX));
    }

    /// Pads with zeros to a multiple of `width`, a power of two up to 8.
    #[inline]
    pub(super) fn align(&mut self, width: usize) {
        let pad = self.len().wrapping_neg() & (width - 1);
        self.out.extend_from_slice(&[0; 8][..pad & 7]);
    }
}
