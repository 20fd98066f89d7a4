// Where a pass over pixels stands and what it writes: in a fragment shader, or with COMPUTE (a
// define) in a compute shader of the same source.
//
// in:  gl_FragCoord, or lib/invocation.glsl
// out: PIXEL          column and row of this pixel, whole numbers, top row first
//      OUTSIDE        whether there is no such pixel
//      WRITE_0, _1    set the pixel of the target's first and second texture
// cpu twin: none
// test:     tests/rendering/gl/test_parity.py

#ifdef COMPUTE
#include "lib/invocation.glsl"
#else
#define PIXEL (gl_FragCoord.xy - 0.5)
#define OUTSIDE false
#define WRITE_0(value) gl_FragData[0] = value
#define WRITE_1(value) gl_FragData[1] = value
#endif
