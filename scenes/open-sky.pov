// Under an even sky: nothing but the background lights the scene, so all of its light is gathered.
//
//   surflux render open-sky.pov -o sky.png
#version 3.7;

global_settings { assumed_gamma 1 }

background { color rgb <0.55, 0.7, 0.95> }

camera { location <4, 3, -8> right x up y look_at <0, 1, 0> angle 40 }

#declare Matte = finish { ambient 0 diffuse 1 }

box { <-6, -0.5, -6>, <6, 0, 6> pigment { color rgb 0.7 } finish { Matte } }
sphere { <-1.1, 1, 0>, 1 pigment { color rgb <0.8, 0.3, 0.15> } finish { Matte } }
box { <-0.7, 0, -0.7>, <0.7, 2, 0.7> rotate 30*y translate <1.3, 0, 0.6> pigment { color rgb 0.8 } finish { Matte } }

// POV-Ray needs a light to show the forms without radiosity.
#ifndef (surflux)
  light_source { <10, 20, -10> color rgb 0.6 }
#end
