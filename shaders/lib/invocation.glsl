// One invocation of a compute shader for every pixel of a window, in squares of 8 x 8: neighbours,
// whose rays end at much the same place, wait for each other.
//
// in:  u_window       first column, first row, width, height, pixels
//      images 0, 1    of rendering/gl/compute_program.py
// out: as lib/pixel.glsl
// cpu twin: none
// test:     tests/rendering/gl/test_compute_program.py

layout(local_size_x = 8, local_size_y = 8) in;

layout(binding = 0) writeonly uniform image2D u_image_0;
layout(binding = 1) writeonly uniform image2D u_image_1;
uniform vec4 u_window;

#define PIXEL (vec2(gl_GlobalInvocationID.xy) + u_window.xy)
#define OUTSIDE any(greaterThanEqual(vec2(gl_GlobalInvocationID.xy), u_window.zw))
#define WRITE_0(value) imageStore(u_image_0, ivec2(PIXEL), value)
#define WRITE_1(value) imageStore(u_image_1, ivec2(PIXEL), value)
