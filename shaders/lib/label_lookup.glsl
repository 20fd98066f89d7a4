// The object of a point, nearest voxel; and tables with one texel an object.
//
//   label = floor(texel max_id + 1/2) at voxel floor(p + 1/2): exact to 65,535, as an 8 or 16 bit
//   normalised texture holds c / max_id (gloo has no integer textures)
//
// in:  u_labels       normalised labels, nearest;  u_label_scale: 255 or 65535
//      u_per_grid     1 / texels, x y z;  u_per_factor: texels a voxel (1 unless the volume was too
//                     large).  Reciprocals, for no compiler divides by them once
//      voxel          nearest voxel, x y z, full resolution
//      id tables      256 wide, row id / 256
// cpu twin: rendering/cpu/object_ids.py
// test:     tests/rendering/gl/test_glsl_functions.py

uniform sampler3D u_labels;
uniform float u_label_scale;
uniform vec3 u_per_grid;
uniform vec3 u_per_factor;

float label_at(vec3 voxel) {
    // Texel centres: no driver rounds those to a neighbour.
    vec3 texel = floor((voxel + 0.5) * u_per_factor) + 0.5;
    return floor(texture3D(u_labels, texel * u_per_grid).r * u_label_scale + 0.5);
}

vec4 table_row(sampler2D table, float rows, float id) {
    float row = floor((id + 0.5) / 256.0);
    return texture2D(table, vec2((id - 256.0 * row + 0.5) / 256.0, (row + 0.5) / rows));
}
