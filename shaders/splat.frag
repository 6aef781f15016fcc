// One pixel of a surfel's box: the exact cover test, the surfel's id or colour, and its inverse depth.
#version 450
#extension GL_EXT_multiview : require
#extension GL_GOOGLE_include_directive : require

#include "frame.glsl"
#include "cover.glsl"

layout(location = 0) flat in vec4 splat_centre_radius;
layout(location = 1) flat in vec3 splat_plane;
layout(location = 2) flat in uvec4 splat_pixels;
#ifdef TRIANGLE
layout(location = 3) flat in vec3 splat_tangent;
layout(location = 4) flat in vec3 splat_bitangent;
#endif
#ifdef COLOUR
layout(location = 5) flat in vec4 splat_colour;
// Whether the atlas holds half floats.
layout(constant_id = 9) const bool HALF = false;

layout(location = 0) out vec4 colour;

// The nearest half float that is neither 0 nor infinite: the twin of AtlasFormat::inverse_depth in src/hemicube/colour.rs. Devices
// round as they like, but what is a half float already stays as it is.
float storable(float depth) {
    if (!HALF) {
        return depth;
    }
    uint bits = floatBitsToUint(clamp(depth, 6.103515625e-5, 65504.0));
    return uintBitsToFloat((bits + 0xfffu + (bits >> 13 & 1u)) & ~0x1fffu);
}
#else
layout(location = 0) out uint id;
#endif

uvec2 unpack(uint v) {
    return uvec2(v & 0xffffu, v >> 16);
}

void main() {
    // The point is a square; the box is not, and neighbouring tiles are near.
    uvec2 pixel = uvec2(gl_FragCoord.xy) - unpack(splat_pixels.y);
    if (any(lessThan(pixel, unpack(splat_pixels.z))) || any(greaterThanEqual(pixel, unpack(splat_pixels.w)))) {
        discard;
    }
    vec2 direction = pixel_direction(uint(gl_ViewIndex), pixel, INVERSE_RESOLUTION);
    float z = inverse_depth(splat_plane, direction);
    vec3 offset = offset_from_centre(splat_centre_radius.xyz, direction, z);
#ifdef TRIANGLE
    bool inside = triangle_covers(offset, splat_tangent, splat_bitangent, splat_centre_radius.w, z);
#else
    bool inside = disc_covers(offset, splat_centre_radius.w, z);
#endif
    if (z <= 0.0 || !inside) {
        discard;
    }
#ifdef COLOUR
    colour = vec4(splat_colour.rgb, splat_colour.a * storable(z));
#else
    id = splat_pixels.x;
#endif
    gl_FragDepth = min(z * DEPTH_SCALE, 1.0);
}
