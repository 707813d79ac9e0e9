//! Reading of CDR, as DDS encodes samples (XTypes 1.3, 7.4): both byte orders, the first and the second version.

/// Fields of a sample that are still to be read. Each reading returns `None` where the sample ends.
#[derive(Clone, Copy, Debug)]
pub struct Reader<'a> {
    /// Content, without the header.
    data: &'a [u8],
    at: usize,
    little: bool,
    /// Alignment of the longest numbers, bytes.
    align_max: usize,
}

impl<'a> Reader<'a> {
    /// Begins with the header; `None`: it has an encoding that is not used for plain types.
    #[must_use]
    pub fn new(sample: &'a [u8]) -> Option<Self> {
        let (header, data) = sample.split_at_checked(4)?;
        let (little, align_max) = match header {
            [0, 0, ..] => (false, 8),
            [0, 1, ..] => (true, 8),
            [0, 6, ..] => (false, 4),
            [0, 7, ..] => (true, 4),
            _ => return None,
        };
        Some(Self { data, at: 0, little, align_max })
    }

    fn take(&mut self, len: usize) -> Option<&'a [u8]> {
        let taken = self.data.get(self.at..)?.get(..len)?;
        self.at += len;
        Some(taken)
    }

    fn number<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.at = self.at.next_multiple_of(N.min(self.align_max));
        let mut bytes: [u8; N] = self.take(N)?.try_into().ok()?;
        if self.little {
            bytes.reverse();
        }
        Some(bytes)
    }

    /// A `uint8`.
    pub fn u8(&mut self) -> Option<u8> {
        self.number().map(u8::from_be_bytes)
    }

    /// A `bool`; `None` also for what is neither 0 nor 1.
    pub fn bool(&mut self) -> Option<bool> {
        match self.u8()? {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        }
    }

    /// A `uint8[N]`.
    pub fn bytes<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    /// A `uint64`.
    pub fn u64(&mut self) -> Option<u64> {
        self.number().map(u64::from_be_bytes)
    }

    /// Number of elements of a sequence, at most `most`.
    pub fn count(&mut self, most: usize) -> Option<usize> {
        usize::try_from(self.u32()?).ok().filter(|count| *count <= most)
    }

    /// A `string[]` of at most `most` strings.
    pub fn strings(&mut self, most: usize) -> Option<Vec<&'a str>> {
        (0..self.count(most)?).map(|_| self.string()).collect()
    }

    /// `None`: more follows than the padding of the sample, which belongs to another type then.
    pub fn end(&self) -> Option<()> {
        (self.data.len().saturating_sub(self.at) < 4).then_some(())
    }

    /// A `uint32`.
    pub fn u32(&mut self) -> Option<u32> {
        self.number().map(u32::from_be_bytes)
    }

    /// An `int32`.
    pub fn i32(&mut self) -> Option<i32> {
        self.number().map(i32::from_be_bytes)
    }

    /// A `float64`.
    pub fn f64(&mut self) -> Option<f64> {
        self.number().map(f64::from_be_bytes)
    }

    /// So many `float64`.
    pub fn f64s<const N: usize>(&mut self) -> Option<[f64; N]> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.f64()?;
        }
        Some(numbers)
    }

    /// A `string`.
    pub fn string(&mut self) -> Option<&'a str> {
        let length = self.u32()? as usize;
        let bytes = self.take(length)?;
        // Some send an empty one without its zero.
        core::str::from_utf8(bytes.strip_suffix(&[0]).unwrap_or(bytes)).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_byte_orders_and_versions_are_read() {
        for (header, number) in [(0, 8), (1, 8), (6, 4), (7, 4)] {
            let little = header % 2 == 1;
            let order = |bytes: &[u8]| -> Vec<u8> {
                if little { bytes.to_vec() } else { bytes.iter().rev().copied().collect() }
            };
            let mut sample = vec![0, header, 0, 0];
            sample.extend(order(&3_u32.to_le_bytes()));
            sample.extend(b"ab\0");
            sample.resize(4 + number.max(8), 0);
            sample.extend(order(&1.5_f64.to_le_bytes()));
            let mut reader = Reader::new(&sample).unwrap();
            assert_eq!((reader.string(), reader.f64()), (Some("ab"), Some(1.5)), "{header}");
            assert_eq!((reader.u32(), reader.i32()), (None, None));
        }
    }

    #[test]
    fn what_is_cut_off_or_encoded_otherwise_is_none() {
        assert!(Reader::new(&[0, 1, 0]).is_none());
        assert!(Reader::new(&[0, 3, 0, 0, 1, 2, 3, 4]).is_none());
        let mut reader = Reader::new(&[0, 1, 0, 0, 255, 255, 255, 255, 1]).unwrap();
        assert_eq!(reader.string(), None);
        assert_eq!(Reader::new(&[0, 1, 0, 0, 0, 0, 0]).unwrap().f64s::<1>(), None);
    }
}
