//! Electronic data sheets and device configuration files (CiA 306-1).

mod names;

pub(crate) use names::same_name;
