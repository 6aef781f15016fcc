// The Cornell box of Schmitt's thesis (section 5.1): 16 triangles, two rotated and scaled boxes, 10 units high, an area
// light below the ceiling. No direct light reaches the ceiling.
//
//   surflux render cornell-box.pov -o box.png
//   povray +Icornell-box.pov +W500 +H500 [Declare=Radiosity=1]
//
// A file that includes this one may declare `Contents`, an object that takes the place of the two boxes.
#version 3.7;

global_settings {
  assumed_gamma 1
  #ifdef (Radiosity)
    radiosity {
      pretrace_start 0.08 pretrace_end 0.01 count 200 nearest_count 8 error_bound 0.4 recursion_limit 1
      low_error_factor 0.5 gray_threshold 0 minimum_reuse 0.01 brightness 1
    }
  #end
}

camera { location <0, 5, -19.2> right x up y look_at <0, 5, 0> angle 39 }

#declare Matte = finish { ambient 0 diffuse 1 }
#declare White = texture { pigment { color rgb <0.75, 0.75, 0.75> } finish { Matte } }
#declare Red = texture { pigment { color rgb <0.65, 0.06, 0.05> } finish { Matte } }
#declare Green = texture { pigment { color rgb <0.13, 0.46, 0.12> } finish { Matte } }

// Floor, back wall and ceiling.
triangle { <-5, 0, -5>, <5, 0, -5>, <5, 0, 5> texture { White } }
triangle { <-5, 0, -5>, <5, 0, 5>, <-5, 0, 5> texture { White } }
triangle { <-5, 0, 5>, <5, 0, 5>, <5, 10, 5> texture { White } }
triangle { <-5, 0, 5>, <5, 10, 5>, <-5, 10, 5> texture { White } }
triangle { <-5, 10, 5>, <5, 10, 5>, <5, 10, -5> texture { White } }
triangle { <-5, 10, 5>, <5, 10, -5>, <-5, 10, -5> texture { White } }

// Left and right wall.
triangle { <-5, 0, -5>, <-5, 0, 5>, <-5, 10, 5> texture { Red } }
triangle { <-5, 0, -5>, <-5, 10, 5>, <-5, 10, -5> texture { Red } }
triangle { <5, 0, 5>, <5, 0, -5>, <5, 10, -5> texture { Green } }
triangle { <5, 0, 5>, <5, 10, -5>, <5, 10, 5> texture { Green } }

// The lamp's panel, an octagon of six triangles: it looks bright, lights nothing, and shades the ceiling. POV-Ray ignores
// `ambient` where it computes radiosity, and takes `emission` instead, which to Surflux would be an area light.
#ifdef (surflux)
  #declare Bright = finish { ambient 1 diffuse 0 }
#else
  #declare Bright = finish { ambient 0 emission 1 diffuse 0 }
#end
#declare Panel = texture { pigment { color rgb <1, 0.97, 0.9> } finish { Bright } }
union {
  triangle { <-1.5, 9.985, -0.62>, <-1.5, 9.985, 0.62>, <-0.62, 9.985, 1.5> }
  triangle { <-1.5, 9.985, -0.62>, <-0.62, 9.985, 1.5>, <0.62, 9.985, 1.5> }
  triangle { <-1.5, 9.985, -0.62>, <0.62, 9.985, 1.5>, <1.5, 9.985, 0.62> }
  triangle { <-1.5, 9.985, -0.62>, <1.5, 9.985, 0.62>, <1.5, 9.985, -0.62> }
  triangle { <-1.5, 9.985, -0.62>, <1.5, 9.985, -0.62>, <0.62, 9.985, -1.5> }
  triangle { <-1.5, 9.985, -0.62>, <0.62, 9.985, -1.5>, <-0.62, 9.985, -1.5> }
  texture { Panel }
  no_radiosity
}

// The light itself, just below the panel.
light_source { <0, 9.98, 0> color rgb <0.9, 0.87, 0.8> area_light <2, 0, 0>, <0, 0, 2>, 9, 9 jitter }

#ifdef (Contents)
  object { Contents }
#else
  box { <-1, -1, -1>, <1, 1, 1> scale <1.5, 3, 1.5> rotate <0, 18, 0> translate <-1.8, 3, 1.6> texture { White } }
  box { <-1, -1, -1>, <1, 1, 1> scale 1.5 rotate <0, -17, 0> translate <1.9, 1.5, -1.5> texture { White } }
#end
