// Density and gradient of a point from single voxels, for software rasterisers: the 32 voxels that
// both need, each read once, where seven filtered samples (lib/density.glsl, lib/gradient.glsl)
// read 56 and work out their places anew each time. llvmpipe takes 0.75 of the time for a frame.
//
//   density = trilinear blend of the cell [i, i + 1]^3 around p
//   gradient = the same blend of the voxels' central differences, which is the central
//              difference of the interpolated density one voxel to both sides
//
// in:  u_voxels       x fastest, in the density texture's unit (rendering/gl/voxel_buffer.py)
//      p              voxels, x y z; beyond the edge are the voxels at the edge
//      last, stride   of the volume: its last voxel, and how far apart neighbours lie; handed in,
//                     for no driver takes them out of a loop
// out: gradient per voxel, density
// cpu twin: rendering/cpu/simd/arithmetic.py (blend_cell)
// test:     tests/rendering/gl/test_glsl_functions.py

#include "lib/ray_box.glsl"

uniform samplerBuffer u_voxels;

float voxel(int at) {
    return texelFetchBuffer(u_voxels, at).r;
}

float pair(int row, ivec2 x, vec2 share) {
    return share.x * voxel(row + x.x) + share.y * voxel(row + x.y);
}

vec4 four(int row, ivec2 outer, ivec2 inner) {
    return vec4(voxel(row + outer.x), voxel(row + inner.x), voxel(row + inner.y), voxel(row + outer.y));
}

vec4 gradient_and_density_at(vec3 p, ivec3 last, ivec3 stride) {
    vec3 corner = floor(p);
    vec3 f = p - corner;
    vec3 e = 1.0 - f;
    ivec3 first = ivec3(corner);
    ivec3 before = max(first - 1, ivec3(0)) * stride;
    ivec3 near = max(first, ivec3(0)) * stride;
    ivec3 far = min(first + 1, last) * stride;
    ivec3 after = min(first + 2, last) * stride;
    ivec2 inner = ivec2(near.x, far.x);
    ivec2 outer = ivec2(before.x, after.x);
    vec2 share = vec2(e.x, f.x);

    // The cell's four rows along x, a voxel more at both ends; named by their z and y.
    vec4 nn = four(near.z + near.y, outer, inner);
    vec4 nf = four(near.z + far.y, outer, inner);
    vec4 fn = four(far.z + near.y, outer, inner);
    vec4 ff = four(far.z + far.y, outer, inner);
    vec4 blend = e.z * (e.y * nn + f.y * nf) + f.z * (e.y * fn + f.y * ff);
    float gx = e.x * (blend.z - blend.x) + f.x * (blend.w - blend.y);

    float nn1 = dot(share, nn.yz), nf1 = dot(share, nf.yz);
    float fn1 = dot(share, fn.yz), ff1 = dot(share, ff.yz);
    float low = e.z * pair(near.z + before.y, inner, share) + f.z * pair(far.z + before.y, inner, share);
    float high = e.z * pair(near.z + after.y, inner, share) + f.z * pair(far.z + after.y, inner, share);
    float gy = e.y * (e.z * nf1 + f.z * ff1 - low) + f.y * (high - e.z * nn1 - f.z * fn1);
    low = e.y * pair(before.z + near.y, inner, share) + f.y * pair(before.z + far.y, inner, share);
    high = e.y * pair(after.z + near.y, inner, share) + f.y * pair(after.z + far.y, inner, share);
    float gz = e.z * (e.y * fn1 + f.y * ff1 - low) + f.z * (high - e.y * nn1 - f.y * nf1);
    return vec4(0.5 * vec3(gx, gy, gz), dot(share, blend.yz));
}
