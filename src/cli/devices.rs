//! `surflux devices`: what can gather here.

use crate::error::Result;
use crate::gather::device::list;
use clap::Args;

/// Options of `surflux devices`.
#[derive(Debug, Args)]
pub struct DevicesArgs {}

/// Prints a line for each device, and which one `--device auto` takes.
pub fn run(_: &DevicesArgs) -> Result<()> {
    list().iter().for_each(|device| println!("{device}"));
    Ok(())
}
