//! `render()`: the way from a scene to a picture, on one page.

use crate::direct::DirectLight;
use crate::error::{Error, Result};
use crate::film::{Aov, Film};
use crate::gather::device::Chosen;
use crate::run::Run;
use crate::scenery::Scenery;
use crate::settings::{GatherMethod, Settings};
use crate::shading::direct::direct_light;
use crate::shading::indirect::{Gathering, IndirectLight};
use crate::shading::points::View;
use crate::shading::shade::develop;
use crate::shading::visible::Visible;
use crate::stats::{Stage, workers_time};
use crate::surfel::cloud::SurfelCloud;
use crate::world::World;
use std::ops::Range;

/// Pixels that are rendered together: all of an ordinary picture, few enough to bound the memory of a huge one.
const BAND_PIXELS: u32 = 1 << 22;

/// Makes a scene ready and renders a view of it. Camera rays need no surfels, nor does direct light: they come at the same
/// time, so that no core is idle where making surfels cannot be shared.
///
/// # Errors
/// When surfels cannot be generated as asked, the device fails, or the user interrupts.
pub fn render_scene(
    scenery: &Scenery,
    cloud: Option<SurfelCloud>,
    view: &View,
    settings: &Settings,
    aovs: &[Aov],
    run: &Run,
) -> Result<(World, Film)> {
    let look = |scenery: &Scenery, device| {
        let rows = bands(view).next().unwrap_or_default();
        Band::look(scenery, view, rows, run)?.lit_early(scenery, view, settings, device, run)
    };
    let (world, first) = World::prepare_beside(scenery, cloud, settings, run, look)?;
    let film = render_from(&world, view, settings, aovs, run, Some(first))?;
    Ok((world, film))
}

/// Renders a view of the world.
///
/// Rays through the pixels find what is visible; while the device gathers the indirect light of those points, the CPU's
/// workers compute their direct light; both meet in the film.
///
/// # Errors
/// When the device fails or the user interrupts.
pub fn render(world: &World, view: &View, settings: &Settings, aovs: &[Aov], run: &Run) -> Result<Film> {
    render_from(world, view, settings, aovs, run, None)
}

/// Renders a view of the world whose first rows may already be seen.
fn render_from(
    world: &World,
    view: &View,
    settings: &Settings,
    aovs: &[Aov],
    run: &Run,
    mut first: Option<Band>,
) -> Result<Film> {
    let scenery = world.scenery();
    let mut film = Film::new(view.width, view.height, aovs);
    film.keep_reflected(settings.reflected);
    let mut gathering = match settings.gather {
        GatherMethod::None => None,
        _ => Some(Gathering::new(world, settings, run)?),
    };
    for rows in bands(view) {
        let Band { visible, direct } = match first.take() {
            Some(band) => band,
            None => Band::look(&scenery, view, rows, run)?,
        };
        run.counters.count_shading_points(visible.points.len());
        let light = || direct.map_or_else(|| light(&scenery, view, settings, &visible, run), Ok);
        let (direct, indirect) = match &mut gathering {
            None => (light()?, IndirectLight::none(visible.points.len(), settings)),
            Some(gathering) if gathering.on_cpu() => (light()?, gathering.light(view, &visible)?),
            Some(gathering) => side_by_side(run, light, || gathering.light(view, &visible))?,
        };
        develop(world, view, &visible, &direct, &indirect, &mut film);
    }
    Ok(film)
}

/// Rows of the picture before light is gathered.
struct Band {
    visible: Visible,
    /// Direct light, if it is known.
    direct: Option<Vec<DirectLight>>,
}

impl Band {
    fn look(scenery: &Scenery, view: &View, rows: Range<u32>, run: &Run) -> Result<Self> {
        let visible = run.clock.time(Stage::Trace, || Visible::trace(view, &scenery.accel, rows))?;
        Ok(Self { visible, direct: None })
    }

    /// With its direct light, unless there will be time for that while a device gathers.
    fn lit_early(
        self,
        scenery: &Scenery,
        view: &View,
        settings: &Settings,
        device: Chosen,
        run: &Run,
    ) -> Result<Self> {
        match device {
            Chosen::Vulkan(_) => Ok(self),
            Chosen::Cpu => {
                let direct = light(scenery, view, settings, &self.visible, run)?;
                Ok(Self { direct: Some(direct), ..self })
            }
        }
    }
}

fn light(
    scenery: &Scenery,
    view: &View,
    settings: &Settings,
    visible: &Visible,
    run: &Run,
) -> Result<Vec<DirectLight>> {
    run.clock.time(Stage::Direct, || direct_light(scenery, view, settings, visible))
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
///
/// # Errors
/// That of the first, or of the second.
pub fn side_by_side<A, B: Send>(
    run: &Run,
    here: impl FnOnce() -> Result<A>,
    there: impl FnOnce() -> Result<B> + Send,
) -> Result<(A, B)> {
    std::thread::scope(|scope| {
        let there = scope.spawn(|| {
            let workers = own_workers()?;
            let done = workers.install(there);
            workers.install(workers_time).into_iter().for_each(|time| run.counters.count_workers(time));
            done
        });
        let here = here();
        let there = there.join().unwrap_or_else(|_| Err(Error::Failed("the gather thread stopped".into())));
        Ok((here?, there?))
    })
}
