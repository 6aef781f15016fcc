// One hemicube a workgroup (or a part of one, where faces are large), which is one subgroup. Lanes take turns at two roles: as
// surfels, they are turned into the hemicube's frame and learn which strips of its faces they may touch; as pixels of a
// strip, they test each of those surfels, handed round by shuffles. A strip is as wide as the subgroup and four rows high, so
// that its depths and winners stay in registers.
//
// Written for lavapipe: it executes both sides of a branch, and every loop at least once; reads of storage buffers are dear,
// texel fetches less so, shuffles from known lanes cheap. It ends a workgroup's loops after 65535 rounds in all, so that
// long cuts take several dispatches.
#version 450
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_shuffle : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "frame.glsl"
#include "cover.glsl"

// The subgroup's size.
layout(local_size_x_id = 9) in;
const uint LANES = gl_WorkGroupSize.x;
// Most surfels of a cut that one dispatch draws.
layout(constant_id = 10) const uint MOST_SURFELS = 1;
// Whether there are so many surfels that cuts may be longer than that.
layout(constant_id = 11) const bool LONG_CUTS = false;
// Strips of a workgroup, MOST_STRIPS at most, and workgroups of a hemicube.
layout(constant_id = 12) const uint STRIPS = 1;
layout(constant_id = 13) const uint PARTS = 1;

const uint ROWS = 4;
const uint MOST_STRIPS = 24;
// Surfels that a lane looks through before it draws what it has found: a bit each.
const uint LOOKED_THROUGH = 32;

// Arrays of the structures that the vertex stage of splat.vert reads too, as words.
layout(set = 0, binding = 0) uniform usamplerBuffer surfels;
layout(set = 0, binding = 1) uniform usamplerBuffer cuts;
layout(set = 0, binding = 2) uniform usamplerBuffer hemicubes;
layout(set = 0, binding = 3) buffer Atlas {
    uint ids[];
} atlas;
#ifdef TRIANGLE
layout(set = 0, binding = 4) uniform usamplerBuffer axes;
#endif

layout(push_constant) uniform Dispatch {
    // Tiles of the atlas.
    uint columns;
    uint rows;
    // Surfels of every cut that earlier dispatches have drawn.
    uint drawn;
} dispatch;

struct Hemicube {
    vec3 position;
    vec3 tangent;
    vec3 bitangent;
    vec3 normal;
    bool inside;
    uint first;
    uint count;
};

struct Strip {
    uint face;
    uvec2 corner;
    // Columns of directions, a lane each.
    float u;
};

struct Surfel {
    vec3 centre;
    vec3 plane;
    float radius;
#ifdef TRIANGLE
    vec3 tangent;
    vec3 bitangent;
#endif
    // Place in the cut, counted from 1.
    int mark;
};

Hemicube hemicube(uint index) {
    uvec4 a = texelFetch(hemicubes, int(4u * index));
    uvec4 b = texelFetch(hemicubes, int(4u * index + 1u));
    uvec4 c = texelFetch(hemicubes, int(4u * index + 2u));
    uvec4 d = texelFetch(hemicubes, int(4u * index + 3u));
    uint drawn = min(dispatch.drawn, c.w);
    return Hemicube(
        uintBitsToFloat(a.xyz),
        uintBitsToFloat(b.xyz),
        uintBitsToFloat(c.xyz),
        uintBitsToFloat(d.xyz),
        (a.w & RECEIVER_INSIDE) != 0u,
        b.w + drawn,
        min(c.w - drawn, MOST_SURFELS)
    );
}

uint strips_across() {
    return (RESOLUTION + LANES - 1u) / LANES;
}

uint strips_of(uint face) {
    return strips_across() * ((rows(face, RESOLUTION) + ROWS - 1u) / ROWS);
}

// One of the workgroup's strips. The last workgroup may have too many, on faces that there are not.
Strip strip(uint index) {
    // A known number where there is one workgroup: then faces and bounds are known to the compiler too.
    uint i = PARTS == 1u ? index : index + gl_WorkGroupID.y * STRIPS;
    uint top = strips_of(0u);
    uint face = i < top ? 0u : 1u + (i - top) / strips_of(1u);
    uint place = i < top ? i : (i - top) % strips_of(1u);
    uvec2 corner = uvec2(place % strips_across() * LANES, place / strips_across() * ROWS);
    float u = pixel_direction(face, corner + uvec2(gl_SubgroupInvocationID, 0u), INVERSE_RESOLUTION).x;
    return Strip(face, corner, u);
}

// Bounds of the directions of a strip's pixels: least and greatest u and v.
vec4 bounds(Strip s) {
    vec2 low = pixel_direction(s.face, s.corner, INVERSE_RESOLUTION);
    vec2 high = pixel_direction(s.face, s.corner + uvec2(LANES, ROWS) - 1u, INVERSE_RESOLUTION);
    return vec4(low.x, high.x, low.y, high.y);
}

// Direction of this lane's pixel in a row of the strip.
vec2 pixel_in(Strip s, uint row) {
    return vec2(s.u, pixel_direction(s.face, s.corner + uvec2(0u, row), INVERSE_RESOLUTION).y);
}

// Whether a sphere may reach into the pyramid of a strip's directions.
bool may_touch(vec3 centre, float reach, vec4 bounds) {
    vec4 within = vec4(centre.x, -centre.x, centre.y, -centre.y) + vec4(-1.0, 1.0, -1.0, 1.0) * bounds * centre.z;
    vec4 least = -reach * sqrt(1.0 + bounds * bounds);
    return centre.z > -reach && all(greaterThanEqual(within, least));
}

vec3 to_local(Hemicube h, vec3 v) {
    return rotate(h.tangent, h.bitangent, h.normal, v);
}

vec3 centre_of(Hemicube h, vec3 position) {
    precise vec3 d = position - h.position;
    return to_local(h, d);
}

// The surfel at a place of the cut, or the last where the cut ends before it.
int surfel_at(Hemicube h, uint place) {
    uint last = max(h.count, 1u) - 1u;
    return int(texelFetch(cuts, int(h.first + min(place, last))).x);
}

// For each strip, which of the surfels that this lane looks through may touch it: every `LANES`th from `first` on.
void look_through(Hemicube h, uint first, out uint touching[MOST_STRIPS]) {
    uint found[MOST_STRIPS];
    [[unroll]] for (uint k = 0u; k < STRIPS; k++) {
        found[k] = 0u;
    }
    for (uint i = 0u;;) {
        uint place = first + i * LANES + gl_SubgroupInvocationID;
        vec4 sphere = uintBitsToFloat(texelFetch(surfels, 2 * surfel_at(h, place)));
        vec3 centre = centre_of(h, sphere.xyz);
        // Rounding must not lose anything: a thousandth is far more than it could.
        float reach = 1.001 * sphere.w + 1e-5 * (abs(centre.x) + abs(centre.y) + abs(centre.z));
        uint bit = place < h.count ? 1u << i : 0u;
        [[unroll]] for (uint k = 0u; k < STRIPS; k++) {
            Strip s = strip(k);
            found[k] |= may_touch(to_face(s.face, centre), reach, bounds(s)) ? bit : 0u;
        }
        if (++i == LOOKED_THROUGH || first + i * LANES >= h.count) {
            break;
        }
    }
    [[unroll]] for (uint k = 0u; k < STRIPS; k++) {
        touching[k] = found[k];
    }
}

// A surfel as a face sees it. One that is not seen, or not wanted, has no plane, so that it covers no pixel.
Surfel project(Hemicube h, uint face, int index, bool wanted) {
    vec4 sphere = uintBitsToFloat(texelFetch(surfels, 2 * index));
    uvec4 rest = texelFetch(surfels, 2 * index + 1);
    vec3 centre = centre_of(h, sphere.xyz);
    vec3 normal = to_local(h, uintBitsToFloat(rest.xyz));
    float distance = ordered_dot(normal, centre);
    precise float top = centre.z + sphere.w;
    precise float inverse = 1.0 / distance;
    bool culled = (rest.w & FLAG_CULL_BACK) != 0u && !h.inside;
    bool seen = wanted && top > 0.0 && abs(distance) > PLANE_EPSILON && !(distance > 0.0 && culled);

    Surfel s;
    s.centre = to_face(face, centre);
    precise vec3 plane = to_face(face, normal) * inverse;
    s.plane = seen ? plane : vec3(0.0);
    s.radius = sphere.w;
#ifdef TRIANGLE
    uvec2 a = texelFetch(axes, 3 * index).xy;
    uvec2 b = texelFetch(axes, 3 * index + 1).xy;
    uvec2 c = texelFetch(axes, 3 * index + 2).xy;
    s.tangent = to_face(face, to_local(h, uintBitsToFloat(uvec3(a, b.x))));
    s.bitangent = to_face(face, to_local(h, uintBitsToFloat(uvec3(b.y, c))));
#endif
    s.mark = 0;
    return s;
}

vec3 shuffled(vec3 v, uint lane) {
    return vec3(subgroupShuffle(v.x, lane), subgroupShuffle(v.y, lane), subgroupShuffle(v.z, lane));
}

// Another lane's surfel.
Surfel handed_round(Surfel mine, uint lane) {
    Surfel s;
    s.centre = shuffled(mine.centre, lane);
    s.plane = shuffled(mine.plane, lane);
    s.radius = subgroupShuffle(mine.radius, lane);
#ifdef TRIANGLE
    s.tangent = shuffled(mine.tangent, lane);
    s.bitangent = shuffled(mine.bitangent, lane);
#endif
    s.mark = subgroupShuffle(mine.mark, lane);
    return s;
}

// Puts a surfel into a pixel if it is the nearest so far; among equals, the first in the cut.
void draw(Surfel s, vec2 direction, inout float nearest, inout int winner) {
    float z = inverse_depth(s.plane, direction);
    vec3 offset = offset_from_centre(s.centre, direction, z);
#ifdef TRIANGLE
    bool inside = triangle_covers(offset, s.tangent, s.bitangent, s.radius, z);
#else
    bool inside = disc_covers(offset, s.radius, z);
#endif
    // Nothing is at depth 0, and a mark is never below 0: what has no depth loses both comparisons.
    bool wins = inside && (z > nearest || (z == nearest && s.mark < winner));
    nearest = wins ? z : nearest;
    winner = wins ? s.mark : winner;
}

// The greatest value among all lanes.
uint greatest(uint value) {
    for (uint step = 1u; step < LANES; step *= 2u) {
        value = max(value, subgroupShuffle(value, gl_SubgroupInvocationID ^ step));
    }
    return value;
}

uint texel(Strip s, uvec2 pixel) {
    uint width = dispatch.columns * RESOLUTION;
    uvec2 tile = uvec2(gl_WorkGroupID.x % dispatch.columns, gl_WorkGroupID.x / dispatch.columns);
    uint top = width * dispatch.rows * RESOLUTION;
    uint layer = s.face == 0u ? 0u : top + (s.face - 1u) * (top / 2u);
    return layer + (tile.y * rows(s.face, RESOLUTION) + pixel.y) * width + tile.x * RESOLUTION + pixel.x;
}

bool in_face(Strip s, uvec2 pixel) {
    return s.face < 5u && pixel.x < RESOLUTION && pixel.y < rows(s.face, RESOLUTION);
}

// The id that earlier dispatches left in a pixel.
uint drawn_before(Strip s, uint row) {
    uvec2 pixel = s.corner + uvec2(gl_SubgroupInvocationID, row);
    return dispatch.drawn > 0u && in_face(s, pixel) ? atlas.ids[texel(s, pixel)] : 0u;
}

// The depth of that.
float depth_before(Hemicube h, Strip s, uint row) {
    uint id = drawn_before(s, row);
    Surfel surfel = project(h, s.face, int(max(id, 1u)) - 1, id != 0u);
    return inverse_depth(surfel.plane, pixel_in(s, row));
}

// Depths and winners of the pixels that a lane has in all strips. A winner is a place in the cut, counted from 1; what earlier
// dispatches drew is none of this one's, and wins over equals.
float nearest[MOST_STRIPS * ROWS];
int winner[MOST_STRIPS * ROWS];

void start(Hemicube h) {
    for (uint k = 0u;;) {
        Strip s = strip(k);
        [[unroll]] for (uint y = 0u; y < ROWS; y++) {
            nearest[k * ROWS + y] = 0.0;
            winner[k * ROWS + y] = 0;
        }
        if (LONG_CUTS) {
            nearest[k * ROWS] = depth_before(h, s, 0u);
            nearest[k * ROWS + 1u] = depth_before(h, s, 1u);
            nearest[k * ROWS + 2u] = depth_before(h, s, 2u);
            nearest[k * ROWS + 3u] = depth_before(h, s, 3u);
        }
        if (++k == STRIPS) {
            break;
        }
    }
}

// Draws those of the surfels from `first` on that each lane has found to touch the strip.
void draw_strip(Hemicube h, uint k, uint first, uint touching) {
    Strip s = strip(k);
    vec4 depth = vec4(nearest[k * ROWS], nearest[k * ROWS + 1u], nearest[k * ROWS + 2u], nearest[k * ROWS + 3u]);
    ivec4 mark = ivec4(winner[k * ROWS], winner[k * ROWS + 1u], winner[k * ROWS + 2u], winner[k * ROWS + 3u]);
    uint rounds = greatest(uint(bitCount(touching)));
    for (uint i = 0u;;) {
        bool some = touching != 0u;
        uint next = some ? uint(findLSB(touching)) : 0u;
        touching &= touching - 1u;
        uint place = first + next * LANES + gl_SubgroupInvocationID;
        Surfel mine = project(h, s.face, surfel_at(h, place), some);
        mine.mark = int(place) + 1;
        [[unroll]] for (uint from = 0u; from < LANES; from++) {
            Surfel surfel = handed_round(mine, from);
            // Not a loop: unrolling one, SPIRV-Tools forget what is `precise`.
            draw(surfel, pixel_in(s, 0u), depth.x, mark.x);
            draw(surfel, pixel_in(s, 1u), depth.y, mark.y);
            draw(surfel, pixel_in(s, 2u), depth.z, mark.z);
            draw(surfel, pixel_in(s, 3u), depth.w, mark.w);
        }
        if (++i >= rounds) {
            break;
        }
    }
    [[unroll]] for (uint y = 0u; y < ROWS; y++) {
        nearest[k * ROWS + y] = depth[y];
        winner[k * ROWS + y] = mark[y];
    }
}

// Writes the ids of a strip.
void finish(Hemicube h, uint k) {
    Strip s = strip(k);
    [[unroll]] for (uint y = 0u; y < ROWS; y++) {
        uvec2 pixel = s.corner + uvec2(gl_SubgroupInvocationID, y);
        int mark = winner[k * ROWS + y];
        uint before = LONG_CUTS ? drawn_before(s, y) : 0u;
        uint id = uint(surfel_at(h, uint(max(mark - 1, 0)))) + 1u;
        if (in_face(s, pixel)) {
            atlas.ids[texel(s, pixel)] = mark == 0 ? before : id;
        }
    }
}

void main() {
    Hemicube h = hemicube(gl_WorkGroupID.x);
    start(h);
    for (uint first = 0u;;) {
        uint touching[MOST_STRIPS];
        look_through(h, first, touching);
        for (uint k = 0u;;) {
            draw_strip(h, k, first, touching[k]);
            if (++k == STRIPS) {
                break;
            }
        }
        first += LOOKED_THROUGH * LANES;
        if (first >= h.count) {
            break;
        }
    }
    for (uint k = 0u;;) {
        finish(h, k);
        if (++k == STRIPS) {
            break;
        }
    }
}
