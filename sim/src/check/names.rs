//! A small map by name, without allocation on lookup.

/// Values by name; at most a dozen, so a linear search suffices.
#[derive(Debug)]
pub(super) struct Names<T>(Vec<(Box<str>, T)>);

impl<T> Default for Names<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T: Default> Names<T> {
    /// Entry of a name, created if absent.
    pub fn of(&mut self, name: &str) -> &mut T {
        let place = self.0.iter().position(|(own, _)| **own == *name).unwrap_or_else(|| {
            self.0.push((name.into(), T::default()));
            self.0.len() - 1
        });
        &mut self.0[place].1
    }

    /// Entry of a name, if present.
    pub fn get(&self, name: &str) -> Option<&T> {
        self.0.iter().find(|(own, _)| **own == *name).map(|(_, thing)| thing)
    }

    /// All entries.
    pub fn all(&mut self) -> impl Iterator<Item = (&str, &mut T)> {
        self.0.iter_mut().map(|(name, thing)| (&**name, thing))
    }
}
