//! A scene made ready for gathering: ray queries, lights, and the shaded surfel cloud.

use crate::accel::Accel;
use crate::direct::Lights;
use crate::error::Result;
use crate::gather::Gatherer;
use crate::gather::create::{Surfels, choose_device, create};
use crate::gather::device::{Choice, Chosen};
use crate::gather::order::{Ordered, order};
use crate::gather::traced::{TracedSettings, form_factors};
use crate::heap;
use crate::hemicube::colour::AtlasFormat;
use crate::hemicube::convolve::Convolver;
use crate::hemicube::frame::{RECEIVER_INSIDE, Receiver};
use crate::hemicube::near_field::NearField;
use crate::hemicube::weights::Weights;
use crate::math::hash32;
use crate::run::Run;
use crate::scene::Scene;
use crate::scene::topology::Edges;
use crate::scenery::Scenery;
use crate::settings::{
    BOUNCE_TOLERANCE, Bounces, Emitters, GatherMethod, NEAR_LAMPS, Settings, SurfelDensity,
};
use crate::stats::{DeviceInfo, Stage};
use crate::surfel::closed::ClosedTest;
use crate::surfel::cloud::SurfelCloud;
use crate::surfel::drawable::Drawables;
use crate::surfel::generate::{Density, GenerateSettings, generate};
use crate::surfel::hidden::visible_areas;
use crate::surfel::hit_light::{Anew, HitLight};
use crate::surfel::lookup::{RadianceLookup, SideLookup};
use crate::surfel::near_lamps::lamps_are_near;
use crate::surfel::shade::{ShadeSettings, shade};
use crate::surfel::transfer::{Transfer, reflecting_sides, side_frame};
use crate::surfel::tree::{CutSettings, SurfelTree};
use glam::Vec3;
use rayon::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// What all stages read while a picture is made.
pub struct World {
    /// The scene.
    pub scene: Arc<Scene>,
    /// Ray queries on it.
    pub accel: Arc<Accel>,
    /// Its lights.
    pub lights: Arc<Lights>,
    edges: Arc<Edges>,
    /// Its surfels, shaded; empty when the gather method needs none.
    pub cloud: SurfelCloud,
    /// The hierarchy over the surfels, for level of detail.
    pub tree: Option<SurfelTree>,
    /// What a gather draws: surfels and clusters, with their light.
    pub drawables: Drawables,
    /// The light that surfaces send, for rays to look up: those of traced gathers, or of the near field.
    pub lookup: Option<RadianceLookup>,
    /// The part of it that comes from the lights by one reflection, where there is more.
    direct_lookup: Option<RadianceLookup>,
    /// `Settings::emitters`.
    emitters: Emitters,
    /// Pixel weights of the hemicube.
    pub weights: Weights,
    /// What gathers, and why that.
    pub device: Choice,
    /// Which surfaces are closed.
    pub closed: ClosedTest,
    /// `Settings::near_field`, or what near lamps make of it.
    near_field: f32,
    /// `Settings::atlas_format`.
    format: AtlasFormat,
    /// Whether gathers count what shows its black back.
    census: bool,
    near_field_rays: AtomicU64,
}

impl World {
    /// Builds ray queries and lights, generates surfels unless `cloud` brings them, and shades them.
    ///
    /// # Errors
    /// When surfels cannot be generated as asked, or the device fails.
    pub fn prepare(scene: Scene, cloud: Option<SurfelCloud>, settings: &Settings, run: &Run) -> Result<Self> {
        let scenery = run.clock.time(Stage::Load, || Scenery::new(scene));
        Self::prepare_beside(&scenery, cloud, settings, run, |_, _| Ok(())).map(|(world, ())| world)
    }

    /// As [`World::prepare`], while other threads do something else that needs no surfels, with the device in mind that will
    /// gather.
    ///
    /// # Errors
    /// As [`World::prepare`], or those of what is done beside it.
    pub fn prepare_beside<T: Send>(
        scenery: &Scenery,
        cloud: Option<SurfelCloud>,
        settings: &Settings,
        run: &Run,
        beside: impl FnOnce(&Scenery, Chosen) -> Result<T> + Send,
    ) -> Result<(Self, T)> {
        let mut world = Self::without_surfels(scenery.clone(), settings)?;
        run.reporter.info_once(&format!("device: {} ({})", world.device.name, world.device.reason));
        run.reporter.verbose(|| format!("features: {}", world.scene.features().join(", ")));
        let device = world.device.device;
        let (prepared, done) =
            rayon::join(|| world.prepare_gathering(cloud, settings, run), || beside(scenery, device));
        prepared?;
        Ok((world, done?))
    }

    fn without_surfels(scenery: Scenery, settings: &Settings) -> Result<Self> {
        let Scenery { scene, accel, lights, edges } = scenery;
        Ok(Self {
            scene,
            accel,
            lights,
            edges,
            cloud: SurfelCloud::default(),
            tree: None,
            drawables: Drawables::default(),
            lookup: None,
            direct_lookup: None,
            emitters: settings.emitters,
            weights: Weights::new(settings.face_resolution),
            device: choose_device(settings)?,
            closed: ClosedTest::none(),
            near_field: settings.near_field,
            format: settings.atlas_format,
            census: settings.diagnostics,
            near_field_rays: AtomicU64::new(0),
        })
    }

    fn prepare_gathering(
        &mut self,
        cloud: Option<SurfelCloud>,
        settings: &Settings,
        run: &Run,
    ) -> Result<()> {
        match settings.gather {
            GatherMethod::Hemicube => self.prepare_drawing(cloud, settings, run),
            GatherMethod::Traced => self.prepare_tracing(cloud, settings, run),
            GatherMethod::MonteCarlo | GatherMethod::None => Ok(()),
        }
    }

    /// What camera rays and direct light need of it.
    pub fn scenery(&self) -> Scenery {
        Scenery {
            scene: Arc::clone(&self.scene),
            accel: Arc::clone(&self.accel),
            lights: Arc::clone(&self.lights),
            edges: Arc::clone(&self.edges),
        }
    }

    fn prepare_drawing(&mut self, cloud: Option<SurfelCloud>, settings: &Settings, run: &Run) -> Result<()> {
        self.prepare_surfels(cloud, settings, run)?;
        heap::give_back_after(self.cloud.len());
        self.tree = run.clock.time(Stage::Tree, || (settings.lod > 0.0).then(|| self.surfel_tree()));
        self.drawables = Drawables::new(&self.cloud, self.tree.as_ref());
        heap::give_back_after(self.cloud.len());
        self.drawables.enclosing = self.closed.encloses();
        self.round_light();
        run.reporter.verbose(|| self.surfels_in_words(settings));
        let may_help = self.near_field == 0.0 && settings.near_lamps && !self.format.is_colour();
        if may_help && lamps_are_near(&self.cloud, &self.lights) {
            self.near_field = NEAR_LAMPS;
            run.reporter.verbose(|| {
                "a lamp stands nearer to a surface than surfels there are wide: rays help".to_owned()
            });
        }
        let near_field = self.near_field > 0.0;
        self.bounce(settings, near_field, run)?;
        if near_field {
            self.lookup = Some(self.make_lookup(run));
            heap::give_back_after(self.cloud.len());
        }
        Ok(())
    }

    fn surfel_tree(&self) -> SurfelTree {
        SurfelTree::weighted(&self.cloud, &visible_areas(&self.cloud, &self.accel, &self.closed))
    }

    fn make_lookup(&self, run: &Run) -> RadianceLookup {
        run.clock.time(Stage::Surfels, || RadianceLookup::new(&self.accel, &self.closed, &self.cloud))
    }

    /// Rays that have replaced hemicube pixels near their receivers.
    pub fn near_field_rays(&self) -> u64 {
        self.near_field_rays.load(Ordering::Relaxed)
    }

    /// Rays see true surfaces, one by one: they need no tree.
    fn prepare_tracing(&mut self, cloud: Option<SurfelCloud>, settings: &Settings, run: &Run) -> Result<()> {
        self.prepare_surfels(cloud, settings, run)?;
        self.bounce(settings, true, run)?;
        self.lookup = Some(self.make_lookup(run));
        run.reporter.verbose(|| {
            let bytes = self.lookup.as_ref().map_or(0, RadianceLookup::bytes);
            format!("{} surfels, looked up in {} kB", self.cloud.len(), bytes.div_ceil(1000))
        });
        Ok(())
    }

    fn prepare_surfels(&mut self, given: Option<SurfelCloud>, settings: &Settings, run: &Run) -> Result<()> {
        let closed = || ClosedTest::new(&self.scene, &self.edges, &self.accel);
        self.closed = run.clock.time(Stage::Surfels, closed);
        self.cloud = run.clock.time(Stage::Surfels, || self.surfels(given, settings, run))?;
        Ok(())
    }

    fn surfels(&self, given: Option<SurfelCloud>, settings: &Settings, run: &Run) -> Result<SurfelCloud> {
        let mut cloud = match given {
            Some(cloud) => cloud,
            None => {
                let density = generate_settings(&self.scene, settings);
                generate(&self.scene, &self.edges, &self.closed, &density, &run.reporter)?
            }
        };
        let shading = ShadeSettings {
            emitters: settings.emitters,
            samples: settings.light_samples,
            seed: settings.seed,
        };
        shade(&mut cloud, &self.accel, &self.lights, &shading)?;
        Ok(cloud)
    }

    /// Reflects light among the surfels as often as asked, so that one gather at a shading point sees all bounces. For rays,
    /// the light before that is kept.
    fn bounce(&mut self, settings: &Settings, for_rays: bool, run: &Run) -> Result<()> {
        let among_surfels = match settings.emitters {
            // Shading the surfels was the first reflection of directly sampled light.
            Emitters::Sample => settings.bounces.limit().saturating_sub(1),
            Emitters::Gather => settings.bounces.limit(),
        };
        if among_surfels == 0 {
            return Ok(());
        }
        if for_rays && settings.emitters == Emitters::Sample {
            self.direct_lookup = Some(self.make_lookup(run));
        }
        let transfer = self.transfer(settings, run)?;
        let tolerance = if settings.bounces == Bounces::Infinite { BOUNCE_TOLERANCE } else { 0.0 };
        let (tree, background) = (self.tree.as_ref(), self.scene.background);
        let cloud = &mut self.cloud;
        let made = run
            .clock
            .time(Stage::Convolve, || transfer.bounce(cloud, tree, background, among_surfels, tolerance))?;
        self.relight();
        run.reporter.verbose(|| format!("light bounced {made} times among {} surfels", self.cloud.len()));
        Ok(())
    }

    /// Takes the emitters' own light away from the surfels: a gather then sees reflected light only.
    pub fn hide_emission(&mut self) {
        let cloud = &mut self.cloud;
        for light in [&mut cloud.radiance, &mut cloud.back_radiance] {
            for (light, &emission) in light.iter_mut().zip(&cloud.emission) {
                *light = (*light - emission).max(Vec3::ZERO);
            }
        }
        self.relight();
        if let Some(lookup) = &mut self.lookup {
            *lookup = RadianceLookup::new(&self.accel, &self.closed, &self.cloud);
        }
    }

    /// Gives drawables the light of the surfels.
    fn relight(&mut self) {
        self.drawables.relight(&self.cloud, self.tree.as_ref());
        self.round_light();
    }

    /// Rounds the light of drawables to what an atlas of colours can hold, once for all gathers and devices.
    fn round_light(&mut self) {
        if !self.format.is_colour() {
            return;
        }
        let Drawables { radiance, back_radiance, .. } = &mut self.drawables;
        for light in radiance.iter_mut().chain(back_radiance) {
            *light = self.format.radiance(*light);
        }
    }

    fn surfels_in_words(&self, settings: &Settings) -> String {
        let (surfels, n) = (self.cloud.len(), settings.face_resolution);
        let clusters = self.drawables.len() - surfels;
        format!(
            "{surfels} surfels, {clusters} clusters of them, to be drawn into hemicubes of {n} x {n} pixels"
        )
    }

    /// Gathers at every surfel.
    fn transfer(&self, settings: &Settings, run: &Run) -> Result<Transfer> {
        let sides = reflecting_sides(&self.cloud);
        let receivers: Vec<Receiver> = sides
            .par_iter()
            .map(|&side| {
                let (position, normal) = side_frame(&self.cloud, side);
                self.receiver(position, normal, hash32(side ^ hash32(settings.seed)))
            })
            .collect();
        if settings.gather == GatherMethod::Traced {
            // Traced rows suit traced gathers: they need no tree, and what they see is exact.
            let rays = TracedSettings { samples: settings.gather_samples, seed: settings.seed };
            let lookup = SideLookup::new(&self.accel, &self.closed, &self.cloud);
            let rows = form_factors(&self.accel, &lookup, rays, &receivers)?;
            return Ok(Transfer::from_rows(sides, rows));
        }
        let mut gatherer = self.id_gatherer(settings)?;
        let ordered = self.order(&receivers, settings, gatherer.batch_size());
        Transfer::gather(sides, ordered, &self.drawables, &self.weights, gatherer.as_mut(), run)
    }

    /// The device for the statistics.
    pub fn device_info(&self) -> DeviceInfo {
        let Choice { name, kind, driver, .. } = &self.device;
        DeviceInfo { name: name.clone(), kind: kind.to_string(), driver: driver.clone() }
    }

    /// A receiver, flagged when it stands inside a closed mesh.
    pub fn receiver(&self, position: Vec3, normal: Vec3, seed: u32) -> Receiver {
        let inside = self.closed.receiver_inside(&self.accel, position, normal);
        Receiver { position, normal, seed, flags: if inside { RECEIVER_INSIDE } else { 0 } }
    }

    /// Orders receivers into batches, with cuts of the surfel tree when there is one.
    pub fn order(&self, receivers: &[Receiver], settings: &Settings, batch_size: usize) -> Ordered {
        let cut = CutSettings { lod: settings.lod, resolution: settings.face_resolution };
        order(receivers, self.tree.as_ref(), &cut, batch_size)
    }

    /// What the hits of a gather's rays send; `None` without [`World::lookup`].
    pub fn hit_light(&self) -> Option<HitLight<'_>> {
        let anew = Anew { lights: &self.lights, direct: self.direct_lookup.as_ref() };
        let anew = (self.emitters == Emitters::Sample).then_some(anew);
        self.lookup.as_ref().map(|lookup| HitLight { accel: &self.accel, lookup, anew })
    }

    /// Turns surfel ids into irradiance.
    pub fn convolver(&self) -> Convolver<'_> {
        let mut convolver =
            Convolver::new(&self.drawables, &self.weights, self.scene.background).with_format(self.format);
        if self.census {
            convolver = convolver.with_census();
        }
        match self.hit_light() {
            None => convolver,
            Some(light) => convolver.with_near_field(NearField {
                light,
                radii: self.near_field,
                surfels: self.cloud.len(),
                rays: &self.near_field_rays,
            }),
        }
    }

    /// The gatherer that the settings ask for.
    ///
    /// # Errors
    /// When the device is not there or fails.
    pub fn gatherer(&self, settings: &Settings) -> Result<Box<dyn Gatherer + '_>> {
        self.create_gatherer(Some(self.convolver()), settings)
    }

    /// A gatherer that hands back surfel ids, where the method has any.
    ///
    /// # Errors
    /// As [`World::gatherer`].
    pub fn id_gatherer(&self, settings: &Settings) -> Result<Box<dyn Gatherer + '_>> {
        self.create_gatherer(None, settings)
    }

    fn create_gatherer<'a>(
        &'a self,
        convolver: Option<Convolver<'a>>,
        settings: &Settings,
    ) -> Result<Box<dyn Gatherer + 'a>> {
        let surfels = Surfels { drawables: &self.drawables, light: self.hit_light(), convolver };
        create(self.device.device, &self.accel, &self.lights, surfels, settings)
    }
}

/// Spacing is given in the user's units; everything else here is in scene units.
pub fn generate_settings(scene: &Scene, settings: &Settings) -> GenerateSettings {
    let density = match settings.density {
        SurfelDensity::Count(n) => Density::Count(n),
        SurfelDensity::Spacing(d) => Density::Spacing((d * scene.normalisation.scale) as f32),
        SurfelDensity::PerPrimitive(n) => Density::PerPrimitive(n),
    };
    GenerateSettings { density, shape: settings.shape, seed: settings.seed }
}
