// One hemicube a workgroup, which is one subgroup. Lanes take turns at two roles: as surfels, they are turned into the
// hemicube's frame eight or so at a time; as pixels of a strip, they test each of those surfels, handed round by shuffles.
// A strip is as wide as the subgroup and four rows high, so that its depths and winners stay in registers.
//
// Written for software drivers: they execute both sides of a branch, and every loop at least once; their buffer reads are
// dear, texel fetches and shuffles from known lanes cheap.
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

const uint ROWS = 4;
// Surfels that a lane looks through before it draws what it has found: a bit each.
const uint LOOKED_THROUGH = 32;

// Arrays of the structures that the vertex stage of splat.vert reads too, as words.
layout(set = 0, binding = 0) uniform usamplerBuffer surfels;
layout(set = 0, binding = 1) uniform usamplerBuffer cuts;
layout(set = 0, binding = 2) uniform usamplerBuffer hemicubes;
layout(set = 0, binding = 3) writeonly buffer Atlas {
    uint ids[];
} atlas;
#ifdef TRIANGLE
layout(set = 0, binding = 4) uniform usamplerBuffer axes;
#endif

// Tiles of the atlas.
layout(push_constant) uniform Layout {
    uint columns;
    uint rows;
} tiles;

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
    // Bounds of the directions of all its pixels: least and greatest u and v.
    vec4 bounds;
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
    return Hemicube(
        uintBitsToFloat(a.xyz),
        uintBitsToFloat(b.xyz),
        uintBitsToFloat(c.xyz),
        uintBitsToFloat(d.xyz),
        (a.w & RECEIVER_INSIDE) != 0u,
        b.w,
        c.w
    );
}

uint strips_across() {
    return (RESOLUTION + LANES - 1u) / LANES;
}

uint strips_of(uint face) {
    return strips_across() * ((rows(face, RESOLUTION) + ROWS - 1u) / ROWS);
}

Strip strip(uint index, uint lane) {
    uint top = strips_of(0u);
    uint face = index < top ? 0u : 1u + (index - top) / strips_of(1u);
    uint place = index < top ? index : (index - top) % strips_of(1u);
    uvec2 corner = uvec2(place % strips_across() * LANES, place / strips_across() * ROWS);
    vec2 low = pixel_direction(face, corner, INVERSE_RESOLUTION);
    vec2 high = pixel_direction(face, corner + uvec2(LANES, ROWS) - 1u, INVERSE_RESOLUTION);
    float u = pixel_direction(face, corner + uvec2(lane, 0u), INVERSE_RESOLUTION).x;
    return Strip(face, corner, u, vec4(low.x, high.x, low.y, high.y));
}

// Direction of this lane's pixel in a row of the strip.
vec2 pixel_in(Strip s, uint row) {
    return vec2(s.u, pixel_direction(s.face, s.corner + uvec2(0u, row), INVERSE_RESOLUTION).y);
}

// Whether a sphere may reach into the pyramid of a strip's directions.
bool may_touch(vec3 centre, float radius, vec4 bounds) {
    // Rounding must not lose anything: a thousandth is far more than it could.
    float reach = 1.001 * radius + 1e-5 * (abs(centre.x) + abs(centre.y) + abs(centre.z));
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

// Which of the surfels that this lane looks through may touch the strip: every `LANES`th from `first` on.
uint look_through(Hemicube h, Strip s, uint first) {
    uint touching = 0u;
    for (uint i = 0u;;) {
        uint place = first + i * LANES + gl_SubgroupInvocationID;
        int surfel = surfel_at(h, place);
        vec4 sphere = uintBitsToFloat(texelFetch(surfels, 2 * surfel));
        vec3 centre = to_face(s.face, centre_of(h, sphere.xyz));
        bool touches = place < h.count && may_touch(centre, sphere.w, s.bounds);
        touching |= (touches ? 1u : 0u) << i;
        if (++i == LOOKED_THROUGH || first + i * LANES >= h.count) {
            break;
        }
    }
    return touching;
}

// The surfel at a place of the cut as the strip's face sees it. One that is not seen has no plane, so that no pixel is
// covered.
Surfel project(Hemicube h, uint face, uint place, bool wanted) {
    int index = surfel_at(h, place);
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
    s.mark = int(place) + 1;
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
    uint width = tiles.columns * RESOLUTION;
    uvec2 tile = uvec2(gl_WorkGroupID.x % tiles.columns, gl_WorkGroupID.x / tiles.columns);
    uint top = width * tiles.rows * RESOLUTION;
    uint layer = s.face == 0u ? 0u : top + (s.face - 1u) * (top / 2u);
    return layer + (tile.y * rows(s.face, RESOLUTION) + pixel.y) * width + tile.x * RESOLUTION + pixel.x;
}

void draw_strip(Hemicube h, Strip s) {
    uint lane = gl_SubgroupInvocationID;
    float nearest[ROWS] = float[ROWS](0.0, 0.0, 0.0, 0.0);
    int winner[ROWS] = int[ROWS](0, 0, 0, 0);
    for (uint first = 0u;;) {
        uint touching = look_through(h, s, first);
        uint rounds = greatest(uint(bitCount(touching)));
        for (uint i = 0u;;) {
            bool some = touching != 0u;
            uint next = some ? uint(findLSB(touching)) : 0u;
            touching &= touching - 1u;
            Surfel mine = project(h, s.face, first + next * LANES + lane, some);
            [[unroll]] for (uint k = 0u; k < LANES; k++) {
                Surfel surfel = handed_round(mine, k);
                // Not a loop: unrolling one, SPIRV-Tools forget what is `precise`.
                draw(surfel, pixel_in(s, 0u), nearest[0], winner[0]);
                draw(surfel, pixel_in(s, 1u), nearest[1], winner[1]);
                draw(surfel, pixel_in(s, 2u), nearest[2], winner[2]);
                draw(surfel, pixel_in(s, 3u), nearest[3], winner[3]);
            }
            if (++i >= rounds) {
                break;
            }
        }
        first += LOOKED_THROUGH * LANES;
        if (first >= h.count) {
            break;
        }
    }
    [[unroll]] for (uint y = 0u; y < ROWS; y++) {
        uvec2 pixel = s.corner + uvec2(lane, y);
        int id = surfel_at(h, uint(max(winner[y] - 1, 0))) + 1;
        if (pixel.x < RESOLUTION && pixel.y < rows(s.face, RESOLUTION)) {
            atlas.ids[texel(s, pixel)] = winner[y] == 0 ? 0u : uint(id);
        }
    }
}

void main() {
    Hemicube h = hemicube(gl_WorkGroupID.x);
    uint strips = strips_of(0u) + 4u * strips_of(1u);
    for (uint i = 0u;;) {
        draw_strip(h, strip(i, gl_SubgroupInvocationID));
        if (++i == strips) {
            break;
        }
    }
}
