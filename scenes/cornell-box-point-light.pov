// The thesis's box with a point light in the open: hard shadows, and nothing to sample.
//
//   surflux render cornell-box-point-light.pov -o box.png
#version 3.7;

global_settings { assumed_gamma 1 }

camera { location <0, 5, -19.2> right x up y look_at <0, 5, 0> angle 39 }

light_source { <0, 8.5, -1> color rgb <0.9, 0.87, 0.8> }

#declare Matte = finish { ambient 0 diffuse 1 }
#declare White = texture { pigment { color rgb <0.75, 0.75, 0.75> } finish { Matte } }
#declare Red = texture { pigment { color rgb <0.65, 0.06, 0.05> } finish { Matte } }
#declare Green = texture { pigment { color rgb <0.13, 0.46, 0.12> } finish { Matte } }

mesh {
  triangle { <-5, 0, -5>, <5, 0, -5>, <5, 0, 5> }
  triangle { <-5, 0, -5>, <5, 0, 5>, <-5, 0, 5> }
  triangle { <-5, 0, 5>, <5, 0, 5>, <5, 10, 5> }
  triangle { <-5, 0, 5>, <5, 10, 5>, <-5, 10, 5> }
  triangle { <-5, 10, 5>, <5, 10, 5>, <5, 10, -5> }
  triangle { <-5, 10, 5>, <5, 10, -5>, <-5, 10, -5> }
  texture { White }
}
mesh {
  triangle { <-5, 0, -5>, <-5, 0, 5>, <-5, 10, 5> }
  triangle { <-5, 0, -5>, <-5, 10, 5>, <-5, 10, -5> }
  texture { Red }
}
mesh {
  triangle { <5, 0, 5>, <5, 0, -5>, <5, 10, -5> }
  triangle { <5, 0, 5>, <5, 10, -5>, <5, 10, 5> }
  texture { Green }
}

box { <-1, -1, -1>, <1, 1, 1> scale <1.5, 3, 1.5> rotate <0, 18, 0> translate <-1.8, 3, 1.6> texture { White } }
box { <-1, -1, -1>, <1, 1, 1> scale 1.5 rotate <0, -17, 0> translate <1.9, 1.5, -1.5> texture { White } }
