//! Gathers at points of a prepared world.

use glam::DVec3;
use surflux::direct::{LitPoint, Sampling};
use surflux::gather::stage::gather_all;
use surflux::hemicube::frame::Receiver;
use surflux::run::Run;
use surflux::scene::{Scene, SceneDescription};
use surflux::settings::{Emitters, GatherMethod, Settings};
use surflux::shading::indirect::convolve;
use surflux::world::World;

/// Shadow rays a light at points whose direct light is sampled.
const LIGHT_SAMPLES: u32 = 256;

/// A world and the settings that it was prepared with.
pub struct Gathering {
    pub world: World,
    settings: Settings,
}

impl Gathering {
    pub fn new(description: &SceneDescription, settings: Settings) -> Self {
        let scene = Scene::new(description).expect("cases have geometry");
        let world = World::prepare(scene, None, &settings, &Run::default()).expect("a world");
        Self { world, settings }
    }

    /// Irradiance at points: what the hemicubes gather, and the direct light where the settings say that it is sampled.
    pub fn irradiance(&self, points: &[LitPoint], seed: u32) -> Vec<DVec3> {
        let mut total = self.gathered(points, |_| seed);
        if self.settings.emitters == Emitters::Sample {
            total.iter_mut().zip(points).zip(0..).for_each(|((e, p), stream)| *e += self.direct(p, stream));
        }
        total
    }

    /// What the hemicubes gather at points; `seed` decides how the hemicube of each is turned.
    pub fn gathered(&self, points: &[LitPoint], seed: impl Fn(usize) -> u32) -> Vec<DVec3> {
        let mut total = vec![DVec3::ZERO; points.len()];
        if self.settings.gather == GatherMethod::None {
            return total;
        }
        let world = &self.world;
        let receiver = |(i, p): (usize, &LitPoint)| world.receiver(p.position, p.normal, seed(i));
        let receivers: Vec<Receiver> = points.iter().enumerate().map(receiver).collect();
        let mut gatherer = world.gatherer(&self.settings).expect("a device");
        let ordered = world.order(&receivers, &self.settings, gatherer.batch_size());
        let convolver = world.convolver();
        gather_all(gatherer.as_mut(), ordered.batches, &Run::default(), |gathered| {
            let order = &ordered.order[gathered.batch.first..];
            let found = order.iter().zip(convolve(gathered, &convolver));
            found.for_each(|(&i, e)| total[i as usize] = e.irradiance.as_dvec3());
            Ok(())
        })
        .expect("the device works");
        total
    }

    fn direct(&self, point: &LitPoint, stream: u64) -> DVec3 {
        let sampling = Sampling { seed: 1, stream, samples: LIGHT_SAMPLES };
        self.world.lights.irradiance(&self.world.accel, point, sampling).as_dvec3()
    }
}
