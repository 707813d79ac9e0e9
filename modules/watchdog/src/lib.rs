//! The module that starts and guards all modules.
