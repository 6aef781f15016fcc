//! Small mathematics that several stages share: orthonormal frames, sampling maps, counter-based random numbers.

use glam::{Vec2, Vec3};
use std::f32::consts::PI;

/// A right-handed orthonormal frame: `tangent x bitangent = normal`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// First axis.
    pub tangent: Vec3,
    /// Second axis.
    pub bitangent: Vec3,
    /// Third axis, the unit vector that the frame was made from.
    pub normal: Vec3,
}

impl Frame {
    /// The frame of a unit vector after Duff et al., "Building an Orthonormal Basis, Revisited" (JCGT 2017):
    /// no direction is singular, -z and -0.0 included.
    pub fn from_normal(n: Vec3) -> Self {
        let sign = 1f32.copysign(n.z);
        let a = -1.0 / (sign + n.z);
        let b = n.x * n.y * a;
        Self {
            tangent: Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
            bitangent: Vec3::new(b, sign + n.y * n.y * a, -n.y),
            normal: n,
        }
    }

    /// The frame turned about its normal by `angle` radians.
    pub fn rotated(&self, angle: f32) -> Self {
        let (sin, cos) = angle.sin_cos();
        Self {
            tangent: self.tangent * cos + self.bitangent * sin,
            bitangent: self.bitangent * cos - self.tangent * sin,
            normal: self.normal,
        }
    }

    /// World vector to local coordinates.
    pub fn to_local(&self, v: Vec3) -> Vec3 {
        Vec3::new(self.tangent.dot(v), self.bitangent.dot(v), self.normal.dot(v))
    }

    /// Local coordinates to a world vector.
    pub fn to_world(&self, v: Vec3) -> Vec3 {
        self.tangent * v.x + self.bitangent * v.y + self.normal * v.z
    }
}

/// Mixes 32 bits so that neighbouring inputs give unrelated outputs (the "lowbias32" finaliser of C. Wellons).
pub fn hash32(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// Upper 24 bits of `x` as a number in [0, 1).
#[inline(always)]
pub fn unit_float(x: u32) -> f32 {
    (x >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// Counter-based random numbers: the stream is a function of (seed, stream id) alone, so that results do not
/// depend on how work is shared among threads.
#[derive(Debug, Clone)]
pub struct Rng {
    state: u64,
}

impl Rng {
    /// The stream `id` of `seed`.
    pub fn new(seed: u32, id: u64) -> Self {
        let state = (u64::from(seed) << 32 | 0x9e37_79b9) ^ id.wrapping_mul(0xd134_2543_de82_ef95);
        let mut rng = Self { state };
        rng.next_u32();
        rng
    }

    /// 32 random bits (SplitMix64, upper half).
    pub fn next_u32(&mut self) -> u32 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 32) as u32
    }

    /// A number in [0, 1).
    pub fn unit(&mut self) -> f32 {
        unit_float(self.next_u32())
    }

    /// Two numbers in [0, 1).
    pub fn unit2(&mut self) -> Vec2 {
        Vec2::new(self.unit(), self.unit())
    }
}

/// Unit disc from the unit square, area-preserving and low in distortion (Shirley and Chiu 1997).
pub fn disc_from_square(u: Vec2) -> Vec2 {
    let o = u * 2.0 - 1.0;
    if o == Vec2::ZERO {
        return Vec2::ZERO;
    }
    let (r, phi) = if o.x.abs() > o.y.abs() {
        (o.x, PI / 4.0 * (o.y / o.x))
    } else {
        (o.y, PI / 2.0 - PI / 4.0 * (o.x / o.y))
    };
    Vec2::new(r * phi.cos(), r * phi.sin())
}

/// Direction about +z with density cos(theta)/pi, from the unit square (Malley's method).
pub fn cosine_hemisphere(u: Vec2) -> Vec3 {
    let d = disc_from_square(u);
    d.extend((1.0 - d.length_squared()).max(0.0).sqrt())
}

/// Uniform direction on the unit sphere from the unit square.
pub fn uniform_sphere(u: Vec2) -> Vec3 {
    let z = 1.0 - 2.0 * u.x;
    let r = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = (2.0 * PI * u.y).sin_cos();
    Vec3::new(r * cos, r * sin, z)
}

/// Uniform barycentric coordinates (of vertices 1 and 2) from the unit square (square-root map).
pub fn uniform_triangle(u: Vec2) -> Vec2 {
    let s = u.x.sqrt();
    Vec2::new(s * (1.0 - u.y), s * u.y)
}

/// Relative luminance of linear Rec. 709 RGB.
pub fn luminance(c: Vec3) -> f32 {
    c.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_orthonormal_everywhere() {
        let mut normals = vec![
            Vec3::X,
            Vec3::Y,
            Vec3::Z,
            Vec3::NEG_X,
            Vec3::NEG_Y,
            Vec3::NEG_Z,
            Vec3::new(0.0, 0.0, -1.0 + f32::EPSILON).normalize(),
            Vec3::new(1e-4, 0.0, -1.0).normalize(),
            Vec3::new(1.0, 0.0, -0.0),
        ];
        let mut rng = Rng::new(1, 0);
        normals.extend((0..1000).map(|_| uniform_sphere(rng.unit2())));
        for n in normals {
            let f = Frame::from_normal(n).rotated(0.7);
            assert!((f.tangent.length() - 1.0).abs() < 1e-6, "tangent of {n}");
            assert!((f.bitangent.length() - 1.0).abs() < 1e-6, "bitangent of {n}");
            assert!(f.tangent.dot(f.bitangent).abs() < 1e-6, "angle at {n}");
            assert!((f.tangent.cross(f.bitangent) - n).length() < 1e-6, "handedness at {n}");
        }
    }

    #[test]
    fn cosine_samples_have_the_mean_of_the_cosine_density() {
        let mut rng = Rng::new(7, 3);
        let n = 100_000;
        let mean = (0..n).map(|_| f64::from(cosine_hemisphere(rng.unit2()).z)).sum::<f64>() / f64::from(n);
        assert!((mean - 2.0 / 3.0).abs() < 3e-3, "E[cos] is 2/3 under cos/pi, got {mean}");
    }
}
