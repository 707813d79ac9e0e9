//! CANopen: CiA 301 master and node, CiA 402 axis, EPOS and IclA drives.
