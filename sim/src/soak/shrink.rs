//! Fewer faults that do the same harm (Zeller, Hildebrandt 2002: delta debugging).

/// Smallest sublist found for which `fails` is true and from which no single item can be removed; `fails` must be true
/// for the whole list. `fails` is called at most `tries` times; after that the best list so far is returned.
pub fn shrink<T: Clone>(whole: &[T], mut tries: u32, mut fails: impl FnMut(&[T]) -> bool) -> Vec<T> {
    let mut best = whole.to_vec();
    let mut pieces = 2;
    while best.len() >= 2 {
        let size = best.len().div_ceil(pieces);
        let mut found = None;
        for begin in (0..best.len()).step_by(size) {
            if tries == 0 {
                return best;
            }
            tries -= 1;
            let end = best.len().min(begin + size);
            let rest = [&best[..begin], &best[end..]].concat();
            if fails(&rest) {
                found = Some(rest);
                break;
            }
        }
        match found {
            Some(rest) => {
                best = rest;
                pieces = (pieces - 1).max(2);
            }
            None if size == 1 => break,
            None => pieces = (pieces * 2).min(best.len()),
        }
    }
    if best.len() == 1 && tries > 0 && fails(&[]) { Vec::new() } else { best }
}

#[cfg(test)]
mod tests {
    use super::shrink;

    #[test]
    fn shrinking_keeps_exactly_the_necessary_faults() {
        let whole: Vec<u32> = (0..100).collect();
        let mut asked = 0;
        let left = shrink(&whole, 1000, |list| {
            asked += 1;
            [3, 58, 99].iter().all(|wanted| list.contains(wanted))
        });
        assert_eq!(left, [3, 58, 99]);
        assert!(asked < 120, "{asked}");
        assert_eq!(shrink(&whole, 1000, |list| list.contains(&7)), [7]);
        assert_eq!(shrink(&whole, 1000, |_| true), [0; 0]);
        assert_eq!(shrink(&whole, 1000, |list| list.len() == 100), whole);
    }

    #[test]
    fn shrinking_with_few_attempts_is_not_minimal() {
        let whole: Vec<u32> = (0..100).collect();
        let left = shrink(&whole, 2, |list| list.contains(&7));
        assert!(left.len() < 100 && left.contains(&7));
    }
}
