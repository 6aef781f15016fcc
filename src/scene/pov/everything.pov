// Uses every statement of the language's subset; the tests cut it short at every byte.
#version 3.7;
global_settings { assumed_gamma 1.0 max_trace_level 5 ambient_light rgb <1,1,1> radiosity { count 10 media on } }
#default { texture { pigment { rgb 0.8 } finish { ambient 0 diffuse 0.6 } } }
#declare Size = 2.5e0; #local Name = "text";
#declare Warm = color rgb <1, 0.5, 0.25>*0.9;
#declare Matte = finish { ambient 0.1 diffuse albedo 0.7 }
#declare Brick = texture { pigment { color Warm } finish { Matte specular 0.2 roughness 0.02 } normal { bumps 1 } }
#declare Move = transform { scale 2 rotate <10, 20, 30> translate -y inverse }
#debug concat("size ", str(Size, 0, 3), "\n")
camera { perspective location <0, 2, -5> sky y up y right x*abs(-1) look_at <0, 1, 0> angle 45 }
background { color red 0.1 green 0.2 blue 0.3 }
light_source { <3, 5, -4>, rgb <1, 1, 1> area_light x, z, 4, 4 adaptive 1 jitter circular orient fade_distance 5 fade_power 2 }
#declare I = 0;
#while (I < 3 & Size != 0)
  #if (I = 1) sphere { <I, 1, 0>, 0.5 texture { Brick } } #else box { <I, 0, 0>, <I + 0.5, 1, 1> pigment { rgbf <1, 0, 0, 0.5> } } #end
  #declare I = I + 1;
#end
#ifdef (surflux) plane { y, 0 hollow no_shadow } #else blob { } #end
union {
  triangle { <0,0,0>, <1,0,0>, <0,1,0> pigment { Warm } }
  mesh { triangle { 0, x, y texture { Brick } } smooth_triangle { 0, z, x, z, y, z } inside_vector y }
  mesh2 { vertex_vectors { 4, 0, x, y, z } normal_vectors { 1, z } texture_list { 1, texture { Brick } }
          face_indices { 2, <0,1,2>, 0, <0,2,3>, 0 } normal_indices { 2, <0,0,0>, <0,0,0> } }
  polygon { 5, <0,0>, <1,0>, <1,1>, <0,1>, <0,0> }
  transform { Move } matrix <1,0,0, 0,1,0, 0,0,1, 0,0,0>
  scale <1, 2, 1>*(1 > 0 ? 1 : 2) rotate vcross(x, y)*degrees(pi/4) translate <0, sin(radians(30)), max(1, 2, 3)>
  finish { emission 0.5 phong 0.5 phong_size 20 reflection { 0.1 } }
}
object { sphere { 0, vlength(<0, 3, 4>).x/5 } no_radiosity on interior { ior 1.5 } }
