//! Surveys as a chart: time a gather over hemicubes a batch, a line for each strategy.

use super::strategy::{BATCHES, Strategy};
use super::survey::Survey;
use crate::gather::vulkan::{FacesPerPass, Route};
use crate::measure::plot::{Axis, Colour, Format, Line, Marker, Plot, Point, Scale, Series};

/// The chart of some surveys.
pub fn chart(surveys: &[Survey], subtitle: String) -> Plot {
    let mut x = Axis::new("hemicubes a batch", Scale::Log, Format::Plain);
    x.ticks = BATCHES.iter().map(|&batch| (batch as f64, batch.to_string())).collect();
    let y = Axis::new("microseconds a gather", Scale::Log, Format::Plain);
    let series = surveys.iter().flat_map(|survey| lines(survey, surveys.len() > 1)).collect();
    Plot { title: "What batches bring".into(), subtitle, x, y, series }
}

/// A line for each strategy of a survey.
fn lines(survey: &Survey, several: bool) -> Vec<Series> {
    let mut lines: Vec<(Strategy, Series)> = Vec::new();
    for cell in survey.cells.iter().filter(|cell| !cell.strategy.compares_memory()) {
        let point = Point { x: cell.batch as f64, y: 1e6 * cell.seconds_a_gather(), ..Point::default() };
        match lines.iter_mut().find(|(strategy, _)| *strategy == cell.strategy) {
            Some((_, line)) => line.points.push(point),
            None => lines.push((cell.strategy, line(survey, several, cell.strategy, point))),
        }
    }
    lines.into_iter().map(|(_, line)| line).collect()
}

fn line(survey: &Survey, several: bool, strategy: Strategy, first: Point) -> Series {
    let rasterised = matches!(strategy, Strategy::Vulkan { route: Route::Raster, .. });
    let device = survey.device.name.split(" (").next().unwrap_or_default();
    let name = if several { format!("{device}: {}", strategy.name()) } else { strategy.name() };
    let line = if rasterised { Line::Dashed } else { Line::Solid };
    Series { name, colour: colour(strategy), line, marker: Marker::Disc, points: vec![first] }
}

/// Ways of batches under way have a colour each, whichever route draws: routes differ in dashes.
fn colour(strategy: Strategy) -> Colour {
    match strategy {
        Strategy::Vulkan { faces: FacesPerPass::One, .. } => Colour::Ink,
        Strategy::Vulkan { summed: false, in_flight, .. } => Colour::Palette(in_flight - 1),
        Strategy::Vulkan { in_flight: 1, .. } => Colour::Palette(4),
        Strategy::Vulkan { .. } => Colour::Palette(5),
        Strategy::Cpu { at_once } => Colour::Palette(if at_once { 6 } else { 7 }),
    }
}
