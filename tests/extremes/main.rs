//! Numerical extremes, each with its expected value: a closed form, exact equality, or a Monte Carlo estimate with a computed
//! confidence interval.

mod agreement;
#[allow(dead_code, reason = "shared with other tests, which use other parts of it")]
#[path = "../common/analytic.rs"]
mod analytic;
#[path = "../common/gathering.rs"]
mod gathering;
mod geometry;
mod ids;
mod lights;
mod model;
mod near;
mod normals;
mod properties;
mod qualities;
#[path = "../common/reference.rs"]
mod reference;
mod scale;
mod statistics;
#[path = "../common/vulkan.rs"]
mod vulkan;
