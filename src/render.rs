//! `render()`: the way from a scene to a picture, on one page.

use crate::error::{Error, Result};
use crate::film::{Aov, Film};
use crate::run::Run;
use crate::settings::{GatherMethod, Settings};
use crate::shading::direct::direct_light;
use crate::shading::indirect::{Gathering, IndirectLight};
use crate::shading::points::View;
use crate::shading::shade::develop;
use crate::shading::visible::Visible;
use crate::stats::Stage;
use crate::world::World;
use std::ops::Range;

/// Pixels that are rendered together: all of an ordinary picture, few enough to bound the memory of a huge one.
const BAND_PIXELS: u32 = 1 << 22;

/// Renders a view of the world.
///
/// Rays through the pixels find what is visible; while the device gathers the indirect light of those points, the CPU's
/// workers compute their direct light; both meet in the film.
///
/// # Errors
/// When the device fails or the user interrupts.
pub fn render(world: &World, view: &View, settings: &Settings, aovs: &[Aov], run: &Run) -> Result<Film> {
    let mut film = Film::new(view.width, view.height, aovs);
    film.keep_reflected(settings.reflected);
    let mut gathering = match settings.gather {
        GatherMethod::None => None,
        _ => Some(Gathering::new(world, settings, run)?),
    };
    for rows in bands(view) {
        let visible = run.clock.time(Stage::Trace, || Visible::trace(view, &world.accel, rows))?;
        run.counters.count_shading_points(visible.points.len());
        let light = || run.clock.time(Stage::Direct, || direct_light(world, view, settings, &visible));
        let (direct, indirect) = match &mut gathering {
            None => (light()?, IndirectLight::none(visible.points.len(), settings)),
            Some(gathering) if gathering.on_cpu() => (light()?, gathering.light(view, &visible)?),
            Some(gathering) => side_by_side(light, || gathering.light(view, &visible))?,
        };
        develop(world, view, &visible, &direct, &indirect, &mut film);
    }
    Ok(film)
}

fn own_workers() -> Result<rayon::ThreadPool> {
    let workers = rayon::ThreadPoolBuilder::new().num_threads(rayon::current_num_threads()).build();
    workers.map_err(|error| Error::Failed(format!("no threads for gathering: {error}")))
}

/// Whole rows that are rendered together.
fn bands(view: &View) -> impl Iterator<Item = Range<u32>> {
    let (height, rows) = (view.height, (BAND_PIXELS / view.width).max(1));
    (0..height).step_by(rows as usize).map(move |first| first..height.min(first + rows))
}

/// Does two things at once; the second on threads of its own: it waits for a device, which shall not wait for the first.
fn side_by_side<A, B: Send>(
    here: impl FnOnce() -> Result<A>,
    there: impl FnOnce() -> Result<B> + Send,
) -> Result<(A, B)> {
    std::thread::scope(|scope| {
        let there = scope.spawn(|| own_workers()?.install(there));
        let here = here();
        let there = there.join().unwrap_or_else(|_| Err(Error::Failed("the gather thread stopped".into())));
        Ok((here?, there?))
    })
}
