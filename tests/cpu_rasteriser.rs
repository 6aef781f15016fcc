//! The software rasteriser gives the ids of the plainest reference, whatever the resolution, shape and grouping.

mod common;

use common::{reference, room};
use glam::Vec3;
use surflux::gather::cpu::{CpuGatherer, CpuSettings};
use surflux::gather::order::order;
use surflux::gather::{Batch, Gatherer, Output};
use surflux::hemicube::atlas::IdAtlas;
use surflux::hemicube::convolve::Convolver;
use surflux::hemicube::weights::Weights;
use surflux::surfel::cloud::SurfelShape;
use surflux::surfel::drawable::Drawables;
use surflux::surfel::tree::{CutSettings, SurfelTree};

fn gather(gatherer: &mut CpuGatherer, batch: Batch) -> IdAtlas {
    gatherer.submit(batch).expect("drawing in memory succeeds");
    match gatherer.finish().expect("drawing in memory succeeds").map(|g| g.output) {
        Some(Output::Ids(atlas)) => atlas,
        _ => panic!("the rasteriser answers with ids"),
    }
}

#[test]
fn ids_equal_the_reference() {
    for shape in [SurfelShape::Disc, SurfelShape::Triangle] {
        for (resolution, count) in [(4, 40), (6, 40), (8, 200), (10, 20), (16, 60), (32, 30), (256, 2)] {
            let cloud = room::cloud(1501, shape, resolution);
            let drawables = Drawables::new(&cloud, None);
            let all: Vec<u32> = (0..cloud.len() as u32).collect();
            let settings = CpuSettings { resolution, batch: 256, frames_in_flight: 1 };
            let mut cpu = CpuGatherer::new(drawables.splats.clone(), drawables.shape, settings)
                .expect("resolution is legal");
            let receivers = room::receivers(count, resolution);
            let atlas = gather(&mut cpu, Batch { receivers: receivers.clone(), ..Batch::default() });
            for (i, receiver) in receivers.iter().enumerate() {
                let expected = reference::hemicube(&drawables, &all, receiver, resolution);
                assert_eq!(atlas.tile(i), expected, "N = {resolution}, {shape:?}, receiver {i}");
            }
        }
    }
}

#[test]
fn cuts_give_the_ids_of_their_drawables() {
    let cloud = room::cloud(3000, SurfelShape::Disc, 9);
    let tree = SurfelTree::new(&cloud);
    let drawables = Drawables::new(&cloud, Some(&tree));
    let settings = CpuSettings { resolution: 8, batch: 64, frames_in_flight: 1 };
    let mut cpu =
        CpuGatherer::new(drawables.splats.clone(), drawables.shape, settings).expect("resolution is legal");
    let receivers = room::receivers(150, 3);
    let ordered = order(&receivers, Some(&tree), &CutSettings { lod: 2.0, resolution: 8 }, 64);
    assert!(ordered.batches.len() > 2, "150 receivers need three batches of 64");
    for batch in ordered.batches {
        let atlas = gather(&mut cpu, batch.clone());
        let (mut first, mut cut) = (0, batch.cuts.as_slice());
        for group in &batch.groups {
            let (own, rest) = cut.split_at(group.drawables as usize);
            assert!(own.iter().any(|&d| d as usize >= cloud.len()), "a coarse cut holds clusters");
            for i in first..first + group.receivers as usize {
                let expected = reference::hemicube(&drawables, own, &batch.receivers[i], 8);
                assert_eq!(atlas.tile(i), expected, "receiver {i} of the batch at {}", batch.first);
            }
            (first, cut) = (first + group.receivers as usize, rest);
        }
    }
}

#[test]
fn a_cut_without_level_of_detail_loses_nothing() {
    let cloud = room::cloud(2000, SurfelShape::Disc, 5);
    let tree = SurfelTree::new(&cloud);
    let drawables = Drawables::new(&cloud, Some(&tree));
    let settings = CpuSettings { resolution: 8, batch: 1000, frames_in_flight: 1 };
    let mut cpu =
        CpuGatherer::new(drawables.splats.clone(), drawables.shape, settings).expect("resolution is legal");
    let receivers = room::receivers(200, 11);
    let ordered = order(&receivers, Some(&tree), &CutSettings { lod: 0.0, resolution: 8 }, 1000);
    let all: Vec<u32> = (0..cloud.len() as u32).collect();
    let depth_of = |tile: Vec<u32>| tile.iter().filter(|&&id| id != 0).count();
    for batch in ordered.batches {
        let receivers = batch.receivers.clone();
        let atlas = gather(&mut cpu, batch);
        for (i, receiver) in receivers.iter().enumerate() {
            // The order of drawing differs, so surfels at equal depth may stand for each other; coverage may not differ.
            let expected = depth_of(reference::hemicube(&drawables, &all, receiver, 8));
            assert_eq!(depth_of(atlas.tile(i)), expected, "pixels covered for receiver {i}");
        }
    }
}

#[test]
fn convolving_at_once_finds_what_the_ids_say() {
    for (resolution, enclosing) in [(4, false), (8, false), (8, true), (16, false)] {
        let cloud = room::cloud(3000, SurfelShape::Disc, 13);
        let tree = SurfelTree::new(&cloud);
        let mut drawables = Drawables::new(&cloud, Some(&tree));
        drawables.enclosing = enclosing;
        let weights = Weights::new(resolution);
        let convolver = Convolver::new(&drawables, &weights, Vec3::new(0.1, 0.5, 2.0));
        let settings = CpuSettings { resolution, batch: 64, frames_in_flight: 1 };
        let new = || CpuGatherer::new(drawables.splats.as_slice(), drawables.shape, settings);
        let mut ids = new().expect("resolution is legal");
        let mut convolving = new().expect("resolution is legal").convolving(convolver);
        let receivers = room::receivers(150, 4);
        for batch in order(&receivers, Some(&tree), &CutSettings { lod: 2.0, resolution }, 64).batches {
            let atlas = gather(&mut ids, batch.clone());
            convolving.submit(batch.clone()).expect("drawing in memory succeeds");
            let found = convolving.finish().expect("drawing in memory succeeds").map(|g| g.output);
            let Some(Output::Estimates(found)) = found else { panic!("it convolves") };
            for (i, receiver) in batch.receivers.iter().enumerate() {
                let expected = convolver.estimate(&atlas, i, receiver);
                let near = (found[i].irradiance - expected.irradiance).abs().max_element() < 1e-4;
                assert!(near, "{:?} is not {expected:?}, N = {resolution}", found[i]);
                let ratio = found[i].closeness / expected.closeness;
                assert!((ratio - 1.0).abs() < 1e-3, "{:?} is not {expected:?}, N = {resolution}", found[i]);
            }
        }
    }
}
