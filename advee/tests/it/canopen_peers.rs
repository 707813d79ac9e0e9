//! CANopen against independent code: `python-canopen` on `python-can`'s `udp_multicast`, as the master of our node, as
//! the slave of our master, as a CiA 402 drive that counts invalid commands, as the wheels of a robot by data sheets of
//! others, and as a device of CiA 401 that stops it.
//!
//! Each test has its own bus: an unused UDP port. The scripts beside this file implement the other side and verify what
//! they receive; they end with 0 on success. Clauses covered by the tests: `docs/conformance/canopen.md`, "Peers".

mod bus;
mod drive;
mod eds;
mod io;
mod master;
mod node;
mod sheets;
mod store;
