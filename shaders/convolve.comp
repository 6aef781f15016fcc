// Turns the ids of hemicubes into sums over their pixels, a workgroup a hemicube: what src/hemicube/tile_sums.rs does on the
// host. Each invocation sums every so-manieth pixel; then one adds their sums in order, so that a hemicube's sum depends on
// nothing but its ids.
#version 450

layout(local_size_x_id = 0) in;
// Pixels along a face's edge.
layout(constant_id = 1) const uint RESOLUTION = 8;
// Nothing is seen nearer than the inverse of this.
layout(constant_id = 2) const float GREATEST_INVERSE_DEPTH = 1.0;
// Whether receivers outside closed surfaces see fronts only.
layout(constant_id = 3) const uint CLOSED = 0;

const uint PIXELS = 3u * RESOLUTION * RESOLUTION;

struct Pixel {
    // Along tangent, bitangent and normal.
    vec3 direction;
    float weight;
    // Weight over the direction's length.
    float closeness;
    uint face;
    uvec2 place;
};

struct Surfel {
    vec3 position;
    // Whether a back is the black one of a one-sided surfel.
    float one_sided;
    vec3 normal;
    float unused;
    vec4 front;
    vec4 back;
};

struct Foot {
    vec3 position;
    uint flags;
    vec3 tangent;
    float unused_tangent;
    vec3 bitangent;
    float unused_bitangent;
    vec3 normal;
    float unused_normal;
};

layout(std430, set = 0, binding = 0) readonly buffer Ids { uint at[]; } ids;
layout(std430, set = 0, binding = 1) readonly buffer Pixels { Pixel at[]; } pixels;
layout(std430, set = 0, binding = 2) readonly buffer Surfels { Surfel at[]; } surfels;
layout(std430, set = 0, binding = 3) readonly buffer Feet { Foot at[]; } feet;
// Two texels a hemicube: radiance and the weight of covered pixels; closeness and the weight of black backs.
layout(std430, set = 0, binding = 4) writeonly buffer Found { vec4 at[]; } found;

layout(push_constant) uniform Tiles {
    // Tiles of the atlas, side by side, and rows of them.
    uint columns;
    uint rows;
} tiles;

shared vec4 light_of[gl_WorkGroupSize.x];
shared vec2 rest_of[gl_WorkGroupSize.x];

// Where a pixel's id is in the packed atlas (src/hemicube/atlas.rs).
uint place(Pixel pixel, uint tile) {
    uint width = tiles.columns * RESOLUTION;
    uint height = pixel.face == 0u ? RESOLUTION : RESOLUTION / 2u;
    uint layer = pixel.face == 0u ? 0u : width * tiles.rows * (RESOLUTION + (pixel.face - 1u) * height);
    uvec2 origin = uvec2(tile % tiles.columns * RESOLUTION, tile / tiles.columns * height);
    return layer + (origin.y + pixel.place.y) * width + origin.x + pixel.place.x;
}

void main() {
    uint tile = gl_WorkGroupID.x;
    uint lane = gl_LocalInvocationID.x;
    Foot foot = feet.at[tile];
    bool fronts = CLOSED != 0u && foot.flags == 0u;
    vec4 light = vec4(0.0);
    vec2 rest = vec2(0.0);
    for (uint i = lane; i < PIXELS; i += gl_WorkGroupSize.x) {
        Pixel pixel = pixels.at[i];
        uint id = ids.at[place(pixel, tile)];
        if (id != 0u) {
            Surfel surfel = surfels.at[id - 1u];
            vec3 across = foot.tangent * pixel.direction.x + foot.bitangent * pixel.direction.y;
            vec3 direction = across + foot.normal * pixel.direction.z;
            float towards = dot(surfel.normal, surfel.position - foot.position);
            float depth = towards == 0.0 ? 0.0 : dot(surfel.normal, direction) / towards;
            vec4 seen = fronts || towards < 0.0 ? surfel.front : surfel.back;
            light += pixel.weight * vec4(seen.rgb, 1.0);
            rest.x += pixel.closeness * clamp(depth, 0.0, GREATEST_INVERSE_DEPTH);
            rest.y += towards > 0.0 ? pixel.weight * surfel.one_sided : 0.0;
        }
    }
    light_of[lane] = light;
    rest_of[lane] = rest;
    barrier();
    if (lane == 0u) {
        for (uint other = 1u; other < gl_WorkGroupSize.x; other++) {
            light += light_of[other];
            rest += rest_of[other];
        }
        found.at[2u * tile] = light;
        found.at[2u * tile + 1u] = vec4(rest, 0.0, 0.0);
    }
}
