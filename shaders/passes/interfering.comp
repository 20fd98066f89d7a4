// Which objects of a view interfere, eq. 1: every pixel scatters the pairs it sees into a table.
//
//   g(o1, o2) = 1 where a pixel of o1 and one of o2 are at most DT apart  (Li et al. 2012, eq. 1);
//   threads only ever write true, so no lock is needed (section 4.2)
//
// in:  Ids            layers x height x width slots, 0 for nothing
//      Halves         half widths of the rows of a disk of radius DT, pixels
//      u_layers, u_height, u_width, u_reach (rows of the disk on either side), u_objects (slots)
// out: Pairs          bit a * n + b, a < b: interfere; the last word: 1 if a pixel saw too many
//      Lengths        at a * n + b: pixels on borders of either that come within DT of the other
// cpu twin: appearance/interference_graph.py (interference)
// test:     tests/rendering/gl/test_interference_pass.py

#include "lib/invocation.glsl"

#define MOST_NEAR 64

layout(std430, binding = 0) readonly buffer Ids { uint ids[]; };
layout(std430, binding = 1) readonly buffer Halves { int halves[]; };
layout(std430, binding = 2) buffer Pairs { uint pairs[]; };
layout(std430, binding = 3) buffer Lengths { uint lengths[]; };

uniform float u_layers;
uniform float u_height;
uniform float u_width;
uniform float u_reach;
uniform float u_objects;

int layers;
int height;
int width;
uint objects;
uint near[MOST_NEAR];
int near_count;

uint id_at(int layer, int row, int col) {
    return ids[(layer * height + row) * width + col];
}

uint place_of(uint a, uint b) {
    return min(a, b) * objects + max(a, b);
}

void interfere(uint a, uint b) {
    uint place = place_of(a, b);
    uint bit = 1u << (place & 31u);
    if ((pairs[place >> 5] & bit) == 0u)
        atomicOr(pairs[place >> 5], bit);
}

void come_near(uint mine, uint other) {
    if (other == 0u || other == mine)
        return;
    for (int i = 0; i < near_count; i++)
        if (near[i] == other)
            return;
    if (near_count == MOST_NEAR) {
        pairs[objects * objects / 32u + 1u] = 1u;
        return;
    }
    near[near_count] = other;
    near_count += 1;
    interfere(mine, other);
    atomicAdd(lengths[place_of(mine, other)], 1u);
}

void look_around(int layer, int row, int col) {
    uint mine = id_at(layer, row, col);
    if (mine == 0u)
        return;
    bool border = id_at(layer, max(row - 1, 0), col) != mine
        || id_at(layer, min(row + 1, height - 1), col) != mine
        || id_at(layer, row, max(col - 1, 0)) != mine
        || id_at(layer, row, min(col + 1, width - 1)) != mine;
    if (!border) {
        // Inside an object only what lies on the very pixel counts, and adds no contact length.
        for (int other = 0; other < layers; other++) {
            uint there = id_at(other, row, col);
            if (there != 0u && there != mine)
                interfere(mine, there);
        }
        return;
    }
    near_count = 0;
    int reach = int(u_reach);
    for (int other = 0; other < layers; other++) {
        for (int k = max(-reach, -row); k <= min(reach, height - 1 - row); k++) {
            int half_width = halves[k + reach];
            int last = min(col + half_width, width - 1);
            for (int c = max(col - half_width, 0); c <= last; c++)
                come_near(mine, id_at(other, row + k, c));
        }
    }
}

void main() {
    if (OUTSIDE)
        return;
    layers = int(u_layers);
    height = int(u_height);
    width = int(u_width);
    objects = uint(u_objects);
    for (int layer = 0; layer < layers; layer++)
        look_around(layer, int(PIXEL.y), int(PIXEL.x));
}
