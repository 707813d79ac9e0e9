//! What a drive keeps in its objects, written only when it changes: a look-up in the dictionary is dear at each step.

use canopen::Node;

/// The last values of `N` objects, in the order in which they are written.
#[derive(Debug)]
pub(super) struct Mirror<const N: usize>([Option<i64>; N]);

impl<const N: usize> Default for Mirror<N> {
    fn default() -> Self {
        Self([None; N])
    }
}

impl<const N: usize> Mirror<N> {
    /// Sets sub-index 0 of these objects, the same ones at each call.
    pub fn write(&mut self, node: &mut Node, objects: [(u16, i64); N]) {
        for (known, (index, value)) in self.0.iter_mut().zip(objects) {
            if known.replace(value) != Some(value) {
                node.set(index, 0, value);
            }
        }
    }
}
