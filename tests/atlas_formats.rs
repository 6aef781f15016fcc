//! Hemicubes of colours give the light that hemicubes of ids give, as far as the format can hold it, on the CPU and by Vulkan.
//!
//! Without lavapipe the tests of Vulkan skip themselves aloud; where the environment variable `CI` is set they fail instead.

mod common;

use common::room;
use common::vulkan::lavapipe;
use glam::Vec3;
use std::f32::consts::PI;
use surflux::gather::cpu::{CpuGatherer, CpuSettings};
use surflux::gather::vulkan::{BatchSize, FacesPerPass, Route, VulkanGatherer, VulkanSettings};
use surflux::gather::{Batch, Estimate, Gatherer};
use surflux::hemicube::colour::AtlasFormat;
use surflux::hemicube::convolve::Convolver;
use surflux::hemicube::frame::Receiver;
use surflux::hemicube::weights::Weights;
use surflux::shading::indirect::convolve;
use surflux::surfel::cloud::SurfelShape;
use surflux::surfel::drawable::Drawables;

/// Half of the distance between neighbouring half floats, relative to them.
const HALF_STEP: f32 = 1.0 / 2048.0;
/// What the order of additions may change, relative to what is added.
const ROUNDING: f32 = 2e-6;
const BACKGROUND: Vec3 = Vec3::new(0.1, 0.2, 0.3);

/// A room whose light is that many times as bright, as an atlas of the format holds it.
fn lit_room(shape: SurfelShape, format: AtlasFormat, brightness: f32) -> Drawables {
    let cloud = room::cloud(1500, shape, 21);
    let mut drawables = Drawables::new(&cloud, None);
    let Drawables { radiance, back_radiance, .. } = &mut drawables;
    for light in radiance.iter_mut().chain(back_radiance) {
        *light = format.radiance(*light * brightness);
    }
    drawables
}

fn gather(gatherer: &mut dyn Gatherer, receivers: &[Receiver], convolver: &Convolver) -> Vec<Estimate> {
    let mut found = Vec::new();
    for receivers in receivers.chunks(gatherer.batch_size()) {
        let batch = Batch { receivers: receivers.to_vec(), ..Batch::default() };
        gatherer.submit(batch).expect("a device that works");
        let gathered = gatherer.finish().expect("a device that works").expect("a batch is under way");
        found.extend(convolve(gathered, convolver));
    }
    found
}

/// What the CPU finds.
fn on_cpu(drawables: &Drawables, format: AtlasFormat, n: u32, receivers: &[Receiver]) -> Vec<Estimate> {
    let weights = Weights::new(n);
    let convolver = Convolver::new(drawables, &weights, BACKGROUND).with_census().with_format(format);
    let settings = CpuSettings { resolution: n, ..CpuSettings::default() };
    let gatherer = CpuGatherer::new(drawables.splats.as_slice(), drawables.shape, settings);
    let mut gatherer = gatherer.expect("a resolution that is allowed").convolving(convolver);
    gather(&mut gatherer, receivers, &convolver)
}

/// What a Vulkan device finds, under the eyes of the validation layer.
fn on_device(
    device: usize,
    drawables: &Drawables,
    format: AtlasFormat,
    settings: VulkanSettings,
    receivers: &[Receiver],
) -> Vec<Estimate> {
    let weights = Weights::new(settings.resolution);
    let convolver = Convolver::new(drawables, &weights, BACKGROUND).with_census().with_format(format);
    let settings = VulkanSettings { validation: true, ..settings };
    let mut gatherer =
        VulkanGatherer::of_drawables(device, drawables, format, settings).expect("lavapipe draws colours");
    assert!(gatherer.strategy().contains(format.name()), "{}", gatherer.strategy());
    let found = gather(&mut gatherer, receivers, &convolver);
    let log = gatherer.validation_log();
    drop(gatherer);
    assert_eq!(log.messages(), Vec::<String>::new(), "the validation layer has nothing to say");
    found
}

/// Asserts that estimates differ by no more than a part of the light, and of everything else. The order of additions
/// also decides how much of the background is left over.
fn assert_near(found: &[Estimate], expected: &[Estimate], tolerance: f32, what: &str) {
    assert_eq!(found.len(), expected.len());
    for (i, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!(a.irradiance.is_finite() && a.closeness.is_finite(), "{what}, {i}: {a:?}");
        let off = (a.irradiance - b.irradiance).abs().max_element();
        let allowed = tolerance * b.irradiance.max_element() + PI * ROUNDING * BACKGROUND.max_element();
        assert!(off <= allowed, "{what}, {i}: off by {off}: {a:?}, {b:?}");
        assert!((a.closeness / b.closeness - 1.0).abs() <= tolerance, "{what}, {i}: {a:?}, {b:?}");
        let coverage = [a.coverage.empty - b.coverage.empty, a.coverage.back - b.coverage.back];
        assert!(coverage.iter().all(|off| off.abs() <= 1e-5), "{what}, {i}: {a:?}, {b:?}");
    }
}

#[test]
fn cpu_and_lavapipe_find_the_same() {
    let Some(device) = lavapipe() else { return };
    for shape in [SurfelShape::Disc, SurfelShape::Triangle] {
        for (format, resolution) in
            AtlasFormat::COLOURS.into_iter().flat_map(|format| [(format, 8), (format, 18)])
        {
            let drawables = lit_room(shape, format, 1.0);
            let receivers = room::receivers(200, resolution);
            let settings = VulkanSettings { resolution, ..VulkanSettings::default() };
            let found = on_device(device, &drawables, format, settings, &receivers);
            let expected = on_cpu(&drawables, format, resolution, &receivers);
            assert!(expected.iter().any(|e| e.coverage.back > 0.1), "black backs are seen");
            assert_near(&found, &expected, ROUNDING, &format!("{shape:?}, {format:?}, N = {resolution}"));
        }
    }
}

#[test]
fn colours_do_not_depend_on_passes_and_batches() {
    let Some(device) = lavapipe() else { return };
    let format = AtlasFormat::Rgba16f;
    let (drawables, receivers) = (lit_room(SurfelShape::Disc, format, 1.0), room::receivers(150, 3));
    let found = |faces, batch| {
        let settings = VulkanSettings { faces, batch: BatchSize::Fixed(batch), ..VulkanSettings::default() };
        on_device(device, &drawables, format, settings, &receivers)
    };
    let whole = found(FacesPerPass::All, 150);
    assert_eq!(found(FacesPerPass::One, 150), whole);
    assert_eq!(found(FacesPerPass::All, 7), whole);
}

#[test]
fn floats_are_as_good_as_ids_and_halves_nearly() {
    let receivers = room::receivers(300, 5);
    for resolution in [8, 16] {
        let of = |format| on_cpu(&lit_room(SurfelShape::Disc, format, 1.0), format, resolution, &receivers);
        let ids = of(AtlasFormat::Id);
        assert_near(&of(AtlasFormat::Rgba32f), &ids, ROUNDING, "floats");
        let halves = of(AtlasFormat::Rgba16f);
        assert_near(&halves, &ids, HALF_STEP + ROUNDING, "halves");
        assert!(halves.iter().zip(&ids).any(|(a, b)| a.irradiance != b.irradiance), "halves are rounded");
    }
}

#[test]
fn the_brightest_light_stays_finite_and_the_faintest_is_no_surprise() {
    let receivers = room::receivers(100, 9);
    let device = lavapipe();
    for brightness in [1e9, 1e-9] {
        for format in AtlasFormat::COLOURS {
            let drawables = lit_room(SurfelShape::Disc, format, brightness);
            let cpu = on_cpu(&drawables, format, 8, &receivers);
            if let Some(device) = device {
                let found = on_device(device, &drawables, format, VulkanSettings::default(), &receivers);
                assert_near(&found, &cpu, ROUNDING, &format!("{format:?}, times {brightness}"));
            }
            let brightest = cpu.iter().map(|e| e.irradiance.max_element()).fold(0.0, f32::max);
            let most = match format {
                AtlasFormat::Rgba16f => 65_504.0f32.max(BACKGROUND.max_element()),
                _ => brightness.max(BACKGROUND.max_element()),
            };
            assert!(brightest > 0.0 && brightest <= PI * most * (1.0 + ROUNDING), "{format:?}: {brightest}");
        }
    }
}

#[test]
fn hemicubes_of_colours_are_not_computed() {
    let Some(device) = lavapipe() else { return };
    let drawables = lit_room(SurfelShape::Disc, AtlasFormat::Rgba32f, 1.0);
    let settings = VulkanSettings { route: Route::Compute, ..VulkanSettings::default() };
    let refused = VulkanGatherer::of_drawables(device, &drawables, AtlasFormat::Rgba32f, settings);
    let error = refused.err().expect("refused");
    assert!(error.exit_code() == 2 && error.to_string().contains("--vulkan-route raster"), "{error}");
}
