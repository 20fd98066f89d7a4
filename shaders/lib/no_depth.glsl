// The depth of a pixel that never became opaque: textures and old drivers are wary of infinity.
//
// unit: mm of t
// cpu twin: rendering/gl/framebuffer.py (NO_DEPTH)
// test:     tests/rendering/gl/test_parity.py

#define NO_DEPTH 1.0e30
