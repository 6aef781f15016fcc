// Faces of the hemicube: the twin of src/hemicube/frame.rs.

// Local coordinates (tangent, bitangent, normal) to the (right, up, forward) coordinates of a face.
vec3 to_face(uint face, vec3 v) {
    switch (face) {
    case 0u: return v;
    case 1u: return vec3(v.y, v.z, v.x);
    case 2u: return vec3(-v.x, v.z, v.y);
    case 3u: return vec3(-v.y, v.z, -v.x);
    default: return vec3(v.x, v.z, -v.y);
    }
}

// Rows of a face's tile.
uint rows(uint face, uint resolution) {
    return face == 0u ? resolution : resolution / 2u;
}

// Direction (u, v) of a pixel's centre at unit distance in front of the face; `inv` is 1 / resolution.
vec2 pixel_direction(uint face, uvec2 pixel, float inv) {
    precise float u = float(2u * pixel.x + 1u) * inv - 1.0;
    precise float v = float(2u * pixel.y + 1u) * inv;
    precise float centred = v - 1.0;
    return vec2(u, face == 0u ? centred : v);
}
