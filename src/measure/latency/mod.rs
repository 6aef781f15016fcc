//! Where a gather's time goes, device by device and strategy by strategy; what batches and overlap bring; and, by a model, what
//! a bus between host and device would take.
//!
//! | file | what it holds |
//! |---|---|
//! | `subject.rs` | the scene, and the points that are gathered at |
//! | `strategy.rs` | the ways of gathering that are compared |
//! | `parts.rs`, `quantiles.rs` | the time of a batch, part by part |
//! | `cell.rs`, `survey.rs` | one measurement; all of a device |
//! | `overlap.rs` | gathers beside direct light |
//! | `link.rs`, `replay.rs` | the model of a bus, in arithmetic and in real time |
//! | `table.rs`, `chart.rs` | what is shown |

mod cell;
mod chart;
pub mod link;
mod overlap;
mod parts;
mod quantiles;
mod replay;
mod strategy;
mod subject;
mod survey;
mod table;

pub use cell::{Cell, Effort};
pub use chart::chart;
pub use overlap::{Load, Overlap};
pub use parts::{BatchTimes, Part, Parts};
pub use quantiles::Quantiles;
pub use strategy::{BATCHES, Strategy};
pub use subject::{Subject, cornell_box};
pub use survey::{Plan, Simulated, Survey};
pub use table::table;
