// A green and a red matte sphere, lit by a third that glows: an area light that is geometry.
//
//   surflux render three-spheres.pov -o spheres.png
#version 3.7;

global_settings { assumed_gamma 1 }

camera { location <0, 3.2, -9> right x up y look_at <0, 1.35, 0> angle 46 }

#declare Matte = finish { ambient 0 diffuse 1 }
#declare Glow = 16;
#declare GlowAt = <-0.2, 3.9, -1.6>;
#declare GlowRadius = 0.6;

sphere { <-1.9, 1.3, 0.4>, 1.3 pigment { color rgb <0.16, 0.62, 0.2> } finish { Matte } }
sphere { <1.7, 1.1, -0.5>, 1.1 pigment { color rgb <0.72, 0.1, 0.07> } finish { Matte } }

#declare GlowColour = rgb <1, 0.86, 0.62>;

// In POV-Ray, emission lights nothing without radiosity. From afar, a sphere of radiance L and radius r gives L r^2 / d^2: a
// light of colour L / 2 that fades from r on does, too.
#ifdef (surflux)
  sphere { GlowAt, GlowRadius pigment { color GlowColour } finish { ambient 0 diffuse 0 emission Glow } }
#else
  light_source {
    GlowAt, color GlowColour * Glow / 2
    fade_distance GlowRadius fade_power 2
    looks_like {
      sphere { 0, GlowRadius pigment { color GlowColour } finish { ambient 0 diffuse 0 emission Glow } no_radiosity }
    }
  }
#end

// Floor and back wall.
mesh {
  triangle { <-7, 0, -9>, <7, 0, -9>, <7, 0, 5> }
  triangle { <-7, 0, -9>, <7, 0, 5>, <-7, 0, 5> }
  triangle { <-7, 0, 5>, <7, 0, 5>, <7, 9, 5> }
  triangle { <-7, 0, 5>, <7, 9, 5>, <-7, 9, 5> }
  pigment { color rgb <0.78, 0.76, 0.72> }
  finish { Matte }
}
