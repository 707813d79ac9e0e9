//! CANopen against code of others: `python-canopen` on `python-can`'s `udp_multicast`, once as the master of our node,
//! once as the slave of our master, once as a CiA 402 drive that counts what it must refuse.
//!
//! Each test has a bus of its own: a UDP port that nobody else has. The scripts beside this file do the other side's
//! part and judge what they see; they end with 0 when all is as it must be. Which clause which test covers:
//! `docs/conformance/canopen.md`, "Peers".

mod bus;
mod drive;
mod eds;
mod master;
mod node;
mod store;
