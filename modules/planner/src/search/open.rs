//! States of a search: open list, and the best path known to each.

use super::lattice::Lattice;
use crate::path::Move;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Index of no state.
pub(crate) const NONE: u32 = u32::MAX;

/// State, and the step that reached it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Node {
    pub(crate) x: f64,
    pub(crate) y: f64,
    /// Cost so far, and lower bound of the remaining cost.
    pub(crate) g: f32,
    pub(crate) h: f32,
    pub(crate) parent: u32,
    /// Key of the state in the table.
    pub(crate) key: u32,
    pub(crate) heading: u8,
    /// Step that led here.
    pub(crate) step: u8,
    pub(crate) closed: bool,
    /// True if an obstacle touches the footprint: the path leaves an obstacle.
    pub(crate) touching: bool,
}

/// All states of a search. A better path to a state is a new node: descendants of the old one keep their exact poses.
#[derive(Debug, Default)]
pub(crate) struct Open {
    nodes: Vec<Node>,
    heap: BinaryHeap<Reverse<u64>>,
    /// Key and node, open addressing; a power of two, at most half full.
    table: Vec<(u32, u32)>,
    used: usize,
}

impl Open {
    pub(crate) fn clear(&mut self) {
        self.nodes.clear();
        self.heap.clear();
        self.used = 0;
        if self.table.is_empty() {
            self.table.resize(1 << 14, (0, NONE));
        } else {
            self.table.fill((0, NONE));
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.nodes.len()
    }

    pub(crate) fn node(&self, index: u32) -> Node {
        self.nodes[index as usize]
    }

    /// True if this cost to a state is lower than the known one.
    pub(crate) fn improves(&self, key: u32, g: f32) -> bool {
        match self.table[self.slot(key)].1 {
            NONE => true,
            known => {
                let known = &self.nodes[known as usize];
                !known.closed && g < known.g
            }
        }
    }

    /// Adds a state with its priority.
    pub(crate) fn push(&mut self, node: Node, f: f32) {
        let index = self.nodes.len() as u32;
        let slot = self.slot(node.key);
        if self.table[slot].1 == NONE {
            self.used += 1;
        }
        self.table[slot] = (node.key, index);
        self.nodes.push(node);
        // Among equals the newest first: it is nearest to the goal.
        self.heap.push(Reverse(u64::from(f.to_bits()) << 32 | u64::from(!index)));
        if self.used * 2 > self.table.len() {
            self.grow();
        }
    }

    /// Closes the most promising state and returns it with its priority.
    pub(crate) fn pop(&mut self) -> Option<(u32, f32)> {
        while let Some(Reverse(first)) = self.heap.pop() {
            let index = !(first as u32);
            let key = self.nodes[index as usize].key;
            if self.table[self.slot(key)].1 == index {
                self.nodes[index as usize].closed = true;
                return Some((index, f32::from_bits((first >> 32) as u32)));
            }
        }
        None
    }

    /// Parts of the path from the start to a state.
    pub(crate) fn trace(&self, index: u32, lattice: &Lattice, parts: &mut Vec<Move>) {
        parts.clear();
        let mut node = &self.nodes[index as usize];
        while node.parent != NONE {
            parts.push(lattice.steps[usize::from(node.step)].part);
            node = &self.nodes[node.parent as usize];
        }
        parts.reverse();
        let mut kept = 0;
        for from in 1..parts.len() {
            let (last, part) = (parts[kept], parts[from]);
            if last.curvature() == part.curvature() && last.direction() == part.direction() {
                parts[kept] = last.with(last.size() + part.size());
            } else {
                kept += 1;
                parts[kept] = part;
            }
        }
        parts.truncate(kept + 1);
    }

    /// Slot of a key in the table, or the free slot for it.
    fn slot(&self, key: u32) -> usize {
        let mask = self.table.len() - 1;
        // Fibonacci hashing: neighbours are spread out.
        let mut slot = (key.wrapping_mul(0x9e37_79b1) >> 7) as usize & mask;
        while self.table[slot].1 != NONE && self.table[slot].0 != key {
            slot = (slot + 1) & mask;
        }
        slot
    }

    fn grow(&mut self) {
        let size = self.table.len() * 2;
        self.table.clear();
        self.table.resize(size, (0, NONE));
        // Later nodes of a key are better.
        for index in 0..self.nodes.len() {
            let key = self.nodes[index].key;
            let slot = self.slot(key);
            self.table[slot] = (key, index as u32);
        }
    }
}
