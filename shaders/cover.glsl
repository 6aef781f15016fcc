// What a surfel covers: the twin of src/hemicube/cover.rs, operation for operation. Everything that decides a pixel is
// `precise`: a fused multiply-add would round differently from the CPU.

// Shared with the CPU; src/gather/vulkan/pass.rs fills them in.
layout(constant_id = 0) const uint RESOLUTION = 8;
layout(constant_id = 1) const float INVERSE_RESOLUTION = 0.125;
layout(constant_id = 2) const float PLANE_EPSILON = 0.0;
layout(constant_id = 3) const float DEPTH_SCALE = 1.0;
layout(constant_id = 4) const float SLACK = 0.0;
layout(constant_id = 5) const float EDGE_COS = 0.5;
layout(constant_id = 6) const float EDGE_SIN = 0.866;
layout(constant_id = 7) const uint FLAG_CULL_BACK = 1;
layout(constant_id = 8) const uint RECEIVER_INSIDE = 1;

// Dot product in the CPU's order of operations.
float ordered_dot(vec3 a, vec3 b) {
    precise float sum = (a.x * b.x + a.y * b.y) + a.z * b.z;
    return sum;
}

// World vector to local coordinates.
vec3 rotate(vec3 tangent, vec3 bitangent, vec3 normal, vec3 v) {
    return vec3(ordered_dot(tangent, v), ordered_dot(bitangent, v), ordered_dot(normal, v));
}

// Half the size of the axis-aligned box about a disc, per axis.
vec3 disc_half_extent(vec3 normal, float radius) {
    precise vec3 one_minus = vec3(1.0) - normal * normal;
    precise vec3 extent = sqrt(max(one_minus, vec3(0.0))) * radius;
    return extent;
}

// The range of (low, high) / z over a box of depths, given the inverses of the nearest and the farthest depth.
vec2 project(float low, float high, float inverse_near, float inverse_far) {
    precise float first = low * (low < 0.0 ? inverse_near : inverse_far);
    precise float last = high * (high < 0.0 ? inverse_far : inverse_near);
    return vec2(first, last);
}

// First pixel, and one past the last, whose centres lie in the range of directions; clamped to 0..limit.
ivec2 pixel_range(vec2 range, float shift, uint limit) {
    float n = float(RESOLUTION);
    precise float first = (range.x + shift) * 0.5 * n - 0.5 - SLACK;
    precise float last = (range.y + shift) * 0.5 * n - 0.5 + SLACK;
    vec2 pixels = vec2(ceil(first), floor(last) + 1.0);
    return ivec2(clamp(pixels, vec2(0.0), vec2(float(limit))));
}

// Pixels that the surfel can cover on a face: (x0, y0, x1, y1), half-open; empty when x0 >= x1 or y0 >= y1.
ivec4 pixel_box(vec3 centre, vec3 half_extent, uint face) {
    uint height = rows(face, RESOLUTION);
    precise float far = centre.z + half_extent.z;
    precise float near = centre.z - half_extent.z;
    precise float grazing = 1e-3 * far;
    if (far <= 0.0) {
        return ivec4(0);
    }
    // A surfel that reaches behind the face's eye may project anywhere.
    if (near <= grazing) {
        return ivec4(0, 0, RESOLUTION, height);
    }
    precise float inverse_near = 1.0 / near;
    precise float inverse_far = 1.0 / far;
    precise vec2 low = centre.xy - half_extent.xy;
    precise vec2 high = centre.xy + half_extent.xy;
    ivec2 x = pixel_range(project(low.x, high.x, inverse_near, inverse_far), 1.0, RESOLUTION);
    ivec2 y = pixel_range(project(low.y, high.y, inverse_near, inverse_far), face == 0u ? 1.0 : 0.0, height);
    return ivec4(x.x, y.x, x.y, y.y);
}

// Inverse depth of the surfel's plane at a pixel's direction.
float inverse_depth(vec3 plane, vec2 direction) {
    precise float z = (plane.x * direction.x + plane.y * direction.y) + plane.z;
    return z;
}

// From the surfel's centre to where the pixel's ray meets its plane, times the inverse depth.
vec3 offset_from_centre(vec3 centre, vec2 direction, float z) {
    precise vec3 offset = vec3(direction, 1.0) - centre * z;
    return offset;
}

// Whether the offset lies within a disc.
bool disc_covers(vec3 offset, float radius, float z) {
    precise float reach = radius * z;
    precise float reach_squared = reach * reach;
    return ordered_dot(offset, offset) <= reach_squared;
}

// Whether the offset lies within an equilateral triangle whose vertex is `radius` along the tangent.
bool triangle_covers(vec3 offset, vec3 tangent, vec3 bitangent, float radius, float z) {
    precise float a = ordered_dot(offset, tangent);
    precise float b = ordered_dot(offset, bitangent);
    precise float reach = radius * z;
    precise float inner = 0.5 * reach;
    precise float along = EDGE_COS * a;
    precise float across = EDGE_SIN * b;
    precise float upper = along + across;
    precise float lower = along - across;
    return upper <= inner && -a <= inner && lower <= inner;
}
