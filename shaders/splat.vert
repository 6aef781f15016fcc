// One surfel seen by one receiver on one face: a point that covers the surfel's pixel box.
// Vertex = surfel, instance = hemicube (or a part of one, where the tile is larger than the largest point), view = face.
#version 450
#extension GL_EXT_multiview : require
#extension GL_GOOGLE_include_directive : require

#include "frame.glsl"
#include "cover.glsl"

// Viewport to clip space, and where points that cover nothing go: inside the viewport, outside the scissor.
layout(push_constant) uniform Viewport {
    vec2 pixel_to_clip;
    vec2 hidden;
} viewport;

layout(location = 0) in vec4 surfel_centre_radius;
layout(location = 1) in vec3 surfel_normal;
layout(location = 2) in uint surfel_flags;
layout(location = 3) in vec3 receiver_position;
layout(location = 4) in uint receiver_flags;
layout(location = 5) in vec3 receiver_tangent;
layout(location = 6) in vec3 receiver_bitangent;
layout(location = 7) in vec3 receiver_normal;
// Upper left texel of the hemicube's tile in layer 0.
layout(location = 8) in uvec2 tile_origin;
// Pixels of the tile that this instance may draw: (x0, y0, x1, y1), half-open.
layout(location = 9) in uvec4 tile_part;
#ifdef TRIANGLE
layout(location = 10) in vec3 surfel_tangent;
layout(location = 11) in vec3 surfel_bitangent;
#define FIRST_COLOUR 12
#else
#define FIRST_COLOUR 10
#endif
#ifdef COLOUR
// What the sides show; alpha is negative for the black back of a surfel that has one side.
layout(location = FIRST_COLOUR) in vec4 surfel_front;
layout(location = FIRST_COLOUR + 1) in vec4 surfel_back;
#endif

layout(location = 0) flat out vec4 splat_centre_radius;
layout(location = 1) flat out vec3 splat_plane;
// Id, tile origin, first pixel of the box, one past its last; pairs packed into 16 bits each.
layout(location = 2) flat out uvec4 splat_pixels;
#ifdef TRIANGLE
layout(location = 3) flat out vec3 splat_tangent;
layout(location = 4) flat out vec3 splat_bitangent;
#endif
#ifdef COLOUR
layout(location = 5) flat out vec4 splat_colour;
#endif

uint pack(uvec2 v) {
    return v.x | v.y << 16;
}

vec3 to_local(vec3 v) {
    return rotate(receiver_tangent, receiver_bitangent, receiver_normal, v);
}

void place(vec2 pixel, float size) {
    gl_PointSize = size;
    gl_Position = vec4(pixel * viewport.pixel_to_clip - 1.0, 0.0, 1.0);
}

void main() {
    uint face = uint(gl_ViewIndex);
    float radius = surfel_centre_radius.w;
    precise vec3 d = surfel_centre_radius.xyz - receiver_position;
    vec3 centre = to_local(d);
    vec3 normal = to_local(surfel_normal);
    float distance = ordered_dot(normal, centre);
    precise float top = centre.z + radius;
    precise float inverse = 1.0 / distance;

    bool culled = (surfel_flags & FLAG_CULL_BACK) != 0u && (receiver_flags & RECEIVER_INSIDE) == 0u;
    bool visible = top > 0.0 && abs(distance) > PLANE_EPSILON && !(distance > 0.0 && culled);

    // Turning to a face only swaps and negates, so that it may come before or after any product.
    vec3 face_centre = to_face(face, centre);
    vec3 face_normal = to_face(face, normal);
    precise vec3 plane = face_normal * inverse;
    ivec4 box = pixel_box(face_centre, disc_half_extent(face_normal, radius), face);
    ivec4 part = ivec4(tile_part);
    part.w = min(part.w, int(rows(face, RESOLUTION)));
    ivec2 low = max(box.xy, part.xy);
    ivec2 high = min(box.zw, part.zw);
    visible = visible && low.x < high.x && low.y < high.y;

    uvec2 origin = uvec2(tile_origin.x, face == 0u ? tile_origin.y : tile_origin.y / 2u);
    splat_centre_radius = vec4(face_centre, radius);
    splat_plane = plane;
    splat_pixels = uvec4(uint(gl_VertexIndex) + 1u, pack(origin), pack(uvec2(low)), pack(uvec2(high)));
#ifdef TRIANGLE
    splat_tangent = to_face(face, to_local(surfel_tangent));
    splat_bitangent = to_face(face, to_local(surfel_bitangent));
#endif
#ifdef COLOUR
    splat_colour = distance < 0.0 ? surfel_front : surfel_back;
#endif

    if (visible) {
        // The square stays inside the part where it fits; what sticks out sticks out to the lower right, so its centre
        // is always inside the viewport.
        int size = max(high.x - low.x, high.y - low.y);
        ivec2 corner = min(low, max(part.zw - size, part.xy));
        place(vec2(origin) + vec2(corner) + 0.5 * float(size), float(size));
    } else {
        place(viewport.hidden, 1.0);
    }
}
