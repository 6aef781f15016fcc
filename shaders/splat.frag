// One pixel of a surfel's box: the exact cover test, the surfel's id and its inverse depth.
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

layout(location = 0) out uint id;

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
    id = splat_pixels.x;
    gl_FragDepth = min(z * DEPTH_SCALE, 1.0);
}
