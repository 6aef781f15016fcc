//! Sweeps: many renders of one scene, each with its time and its error against a reference.
//!
//! A plan lists the settings to try (`plan`); each becomes a record (`record`), a line of a journal that survives being
//! killed (`journal`). Errors are measured against a Monte Carlo picture whose own noise is taken out (`reference`). Records
//! are shown as a table and as charts (`table`, `chart`).

pub mod chart;
pub mod journal;
pub mod pareto;
pub mod plan;
pub mod record;
pub mod referee;
pub mod reference;
pub mod table;
