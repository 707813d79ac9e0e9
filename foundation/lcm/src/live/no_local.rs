//! In place of `local.rs` where the feature `shm` is off: there is no shared-memory bus.

use crate::origin::{Process, Provenance};
use crate::url;
use std::io;
use std::net::SocketAddrV4;
use std::os::fd::{AsFd, BorrowedFd};
use std::time::Duration;

/// Has no value.
#[derive(Debug)]
pub enum Local {}

impl Local {
    pub fn join(_: &url::Udpm, _: SocketAddrV4, _: BorrowedFd<'_>) -> Option<Self> {
        None
    }

    pub fn publish(&mut self, _: u32, _: &str, _: &[u8], _: i64) -> bool {
        match *self {}
    }

    pub fn is_cut(&self) -> bool {
        match *self {}
    }

    pub fn moved(&mut self, _: SocketAddrV4) {
        match *self {}
    }

    pub fn set_interest(&mut self, _: Option<&[&str]>) {
        match *self {}
    }

    pub fn recv(&mut self, _: impl FnMut(&str) -> bool, _: impl Fn(&str, usize) -> bool) -> bool {
        match *self {}
    }

    pub fn passes_socket(&mut self) -> bool {
        match *self {}
    }

    pub fn message(&self) -> (&str, &[u8]) {
        match *self {}
    }

    pub fn provenance(&self) -> Provenance {
        match *self {}
    }

    pub fn process_at(&self, _: SocketAddrV4) -> Option<Process> {
        match *self {}
    }

    pub fn take_lost(&mut self) -> u64 {
        match *self {}
    }

    pub fn takes(&mut self, _: SocketAddrV4, _: &[u8], _: i64) -> bool {
        match *self {}
    }

    pub fn sleep(&mut self, _: bool) -> bool {
        match *self {}
    }

    pub fn ready(&self) -> bool {
        match *self {}
    }

    pub fn wait(&mut self, _: Duration) -> io::Result<()> {
        match *self {}
    }
}

impl AsFd for Local {
    fn as_fd(&self) -> BorrowedFd<'_> {
        match *self {}
    }
}
