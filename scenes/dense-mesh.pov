// The thesis's box around a mesh of 70 000 triangles: a test of scalability.
//
//   surflux render dense-mesh.pov -o knot.png
#version 3.7;

#include "torus-knot.inc"

#declare Contents = object {
  TorusKnot
  rotate <-62, 25, 0> scale 1.12 translate <0, 4.1, 0.4>
  pigment { color rgb <0.82, 0.68, 0.42> }
  finish { ambient 0 diffuse 1 }
}

#include "cornell-box.pov"
