//! Where a gather's time goes, device by device and strategy by strategy.

pub mod link;
pub mod parts;
pub mod quantiles;
