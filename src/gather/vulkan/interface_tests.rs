//! The SPIR-V's interface against the Rust structures that feed it, read from the committed binaries.

use super::pass::{CONSTANTS, Viewport, shaders};
use super::vertices::attributes;
use crate::surfel::cloud::SurfelShape;
use ash::vk;
use std::collections::{BTreeMap, BTreeSet};
use std::mem::offset_of;

const SHAPES: [SurfelShape; 2] = [SurfelShape::Disc, SurfelShape::Triangle];
/// Shapes, and whether their colours are drawn.
const DRAWN: [(SurfelShape, bool); 4] = [
    (SurfelShape::Disc, false),
    (SurfelShape::Disc, true),
    (SurfelShape::Triangle, false),
    (SurfelShape::Triangle, true),
];

// Numbers from the SPIR-V specification.
const OP_TYPE_INT: u32 = 21;
const OP_TYPE_FLOAT: u32 = 22;
const OP_TYPE_VECTOR: u32 = 23;
const OP_TYPE_POINTER: u32 = 32;
const OP_VARIABLE: u32 = 59;
const OP_DECORATE: u32 = 71;
const OP_MEMBER_DECORATE: u32 = 72;
const SPEC_ID: u32 = 1;
const LOCATION: u32 = 30;
const OFFSET: u32 = 35;
const INPUT: u32 = 1;
const OUTPUT: u32 = 3;

/// Scalar kind and number of components.
type Kind = (&'static str, u32);

/// What a module shows to the outside.
#[derive(Default)]
struct Interface {
    inputs: BTreeMap<u32, Kind>,
    outputs: BTreeMap<u32, Kind>,
    constants: BTreeSet<u32>,
    /// Offsets of the members of the push constant block. It is the only block with offsets.
    push_constants: BTreeMap<u32, u32>,
}

/// Instructions as opcode and operands.
fn instructions(code: &[u8]) -> Vec<(u32, Vec<u32>)> {
    let words: Vec<u32> = bytemuck::pod_collect_to_vec(code);
    let mut rest = &words[5..];
    let mut instructions = Vec::new();
    while let Some(&first) = rest.first() {
        let (instruction, tail) = rest.split_at((first >> 16) as usize);
        instructions.push((first & 0xffff, instruction[1..].to_vec()));
        rest = tail;
    }
    instructions
}

fn interface(code: &[u8]) -> Interface {
    let mut found = Interface::default();
    let (mut kinds, mut pointees, mut locations) = (BTreeMap::new(), BTreeMap::new(), BTreeMap::new());
    for (op, operands) in instructions(code) {
        match (op, operands.as_slice()) {
            (OP_TYPE_FLOAT, &[id, 32, ..]) => drop(kinds.insert(id, ("float", 1))),
            (OP_TYPE_INT, &[id, 32, 0]) => drop(kinds.insert(id, ("uint", 1))),
            (OP_TYPE_VECTOR, &[id, scalar, count]) => {
                kinds.get(&scalar).map(|kind| kind.0).map(|kind| kinds.insert(id, (kind, count)));
            }
            (OP_TYPE_POINTER, &[id, _, pointee]) => drop(pointees.insert(id, pointee)),
            (OP_DECORATE, &[_, SPEC_ID, id]) => drop(found.constants.insert(id)),
            (OP_DECORATE, &[id, LOCATION, location]) => drop(locations.insert(id, location)),
            (OP_MEMBER_DECORATE, &[_, member, OFFSET, offset]) => {
                found.push_constants.insert(member, offset);
            }
            (OP_VARIABLE, &[pointer, id, class, ..]) => {
                let Some(&location) = locations.get(&id) else { continue };
                let kind = kinds[&pointees[&pointer]];
                match class {
                    INPUT => found.inputs.insert(location, kind),
                    OUTPUT => found.outputs.insert(location, kind),
                    _ => None,
                };
            }
            _ => {}
        }
    }
    found
}

fn kind(format: vk::Format) -> Kind {
    match format {
        vk::Format::R32G32B32_SFLOAT => ("float", 3),
        vk::Format::R32G32B32A32_SFLOAT => ("float", 4),
        vk::Format::R32_UINT => ("uint", 1),
        vk::Format::R32G32_UINT => ("uint", 2),
        vk::Format::R32G32B32A32_UINT => ("uint", 4),
        other => panic!("{other:?} is no format of ours"),
    }
}

#[test]
fn vertex_attributes_are_the_shaders_inputs() {
    for (shape, colours) in DRAWN {
        let ours: BTreeMap<u32, Kind> =
            attributes(shape, colours).iter().map(|a| (a.location, kind(a.format))).collect();
        assert_eq!(interface(shaders(shape, colours)[0]).inputs, ours, "{shape:?}, colours: {colours}");
    }
}

#[test]
fn attributes_lie_where_the_structures_have_their_fields() {
    let triangle = attributes(SurfelShape::Triangle, true);
    let places: Vec<_> = triangle.iter().map(|a| (a.binding, a.offset)).collect();
    let splat = [(0, 0), (0, 16), (0, 28)];
    let instance = [(1, 0), (1, 12), (1, 16), (1, 28), (1, 40), (1, 52), (1, 60)];
    let axes = [(2, 0), (2, 12)];
    let colours = [(3, 0), (3, 16)];
    assert_eq!(places, [&splat[..], &instance, &axes, &colours].concat());
    let strides =
        super::vertices::bindings(SurfelShape::Triangle, true).iter().map(|b| b.stride).collect::<Vec<_>>();
    assert_eq!(strides, [32, 76, 24, 32]);
}

#[test]
fn vertex_outputs_are_fragment_inputs() {
    for (shape, colours) in DRAWN {
        let [vertex, fragment] = shaders(shape, colours).map(interface);
        assert_eq!(vertex.outputs, fragment.inputs, "{shape:?}, colours: {colours}");
        let texel = if colours { ("float", 4) } else { ("uint", 1) };
        assert_eq!(fragment.outputs, BTreeMap::from([(0, texel)]), "{shape:?}, colours: {colours}");
    }
}

#[test]
fn push_constants_lie_where_the_shader_reads_them() {
    let ours = [offset_of!(Viewport, pixel_to_clip), offset_of!(Viewport, hidden)];
    let ours: BTreeMap<u32, u32> = ours.iter().enumerate().map(|(i, &o)| (i as u32, o as u32)).collect();
    for (shape, colours) in DRAWN {
        assert_eq!(
            interface(shaders(shape, colours)[0]).push_constants,
            ours,
            "{shape:?}, colours: {colours}"
        );
    }
}

#[test]
fn the_compute_shader_reads_push_constants_where_they_lie() {
    use super::compute::{Dispatch, shader};
    let ours = [offset_of!(Dispatch, columns), offset_of!(Dispatch, rows), offset_of!(Dispatch, drawn)];
    let ours: BTreeMap<u32, u32> = ours.iter().enumerate().map(|(i, &o)| (i as u32, o as u32)).collect();
    for shape in SHAPES {
        let interface = interface(shader(shape));
        assert_eq!(interface.push_constants, ours, "{shape:?}");
        let own = CONSTANTS as u32..CONSTANTS as u32 + 5;
        assert!(
            own.clone().all(|id| interface.constants.contains(&id)),
            "{shape:?}: {:?}",
            interface.constants
        );
        assert!(interface.constants.iter().all(|&id| id < own.end), "{shape:?}: {:?}", interface.constants);
    }
}

#[test]
fn every_specialisation_constant_is_filled_in() {
    for (shape, colours) in DRAWN {
        let used: BTreeSet<u32> =
            shaders(shape, colours).iter().flat_map(|code| interface(code).constants).collect();
        // Colours have one more: whether they are half floats.
        let count = CONSTANTS as u32 + u32::from(colours);
        assert!(used.iter().all(|&id| id < count), "{shape:?}, colours: {colours}: {used:?}");
        assert!(used.len() >= 7, "{shape:?} uses the shared constants: {used:?}");
    }
}
