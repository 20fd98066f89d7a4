// Every counter of every object in one pass: run lengths added by atomics, a bit for who blocks whom.
//
//   countOccludedSamples (Li et al. 2012, section 5.1): a run of one object's samples is flushed to
//   its counters at once when the ray leaves it, so that atomics are as many as runs, not samples
//
// in:  lib/ray.glsl, lib/label_lookup.glsl
//      u_objects      n, counted objects
//      Slots          by ID: 0 to n - 1, or -1 where hidden
// out: Counts         5 rows of n: samples, hits, occluded hits, occluded samples, exact samples;
//                     then 1 if a ray met more objects than it can remember
//      Blocks         bit row n + column: the row's object lies in front of the column's
// cpu twin: rendering/cpu/occlusion.py (occlusion_counts)
// test:     tests/rendering/gl/test_occlusion_atomics.py

#include "lib/invocation.glsl"
#include "lib/ray_box.glsl"
#include "lib/skip_empty.glsl"
#include "lib/label_lookup.glsl"

#define MOST_MET 96

layout(std430, binding = 0) readonly buffer Slots { int slots[]; };
layout(std430, binding = 1) buffer Counts { uint counts[]; };
layout(std430, binding = 2) buffer Blocks { uint blocks[]; };

uniform float u_objects;

int met[MOST_MET];
int met_count = 0;
int objects;

void flush(int slot, uint samples) {
    if (slot < 0)
        return;
    atomicAdd(counts[slot], samples);
    if (slot != met[0])
        atomicAdd(counts[3 * objects + slot], samples);
    if (met_count > 1)
        atomicAdd(counts[4 * objects + slot], samples);
}

void meet(int slot) {
    bool known = false;
    for (int i = 0; i < met_count; i++)
        known = known || met[i] == slot;
    if (!known) {
        if (met_count == MOST_MET) {
            counts[5 * objects] = 1u;
            return;
        }
        met[met_count] = slot;
        met_count += 1;
        atomicAdd(counts[objects + slot], 1u);
        if (met_count > 1)
            atomicAdd(counts[2 * objects + slot], 1u);
    }
    for (int i = 0; i < met_count; i++) {
        if (met[i] == slot)
            continue;
        uint place = uint(met[i]) * uint(objects) + uint(slot);
        uint bit = 1u << (place & 31u);
        // Most bits are set by the first few rays: reading is cheaper than an atomic.
        if ((blocks[place >> 5] & bit) == 0u)
            atomicOr(blocks[place >> 5], bit);
    }
}

void main() {
    if (OUTSIDE)
        return;
    objects = int(u_objects);
    vec2 pixel = PIXEL;
    vec3 origin = ray_origin(pixel);
    vec3 direction = ray_direction(pixel);
    vec2 range = sample_range(origin, direction, 0.5);
    float k = range.x;
    float skip_from = u_skip > 0.5 ? k : range.y;
    int current = -1;
    int label = 0;
    uint samples = 0u;
    while (k < range.y) {
        while (k < range.y && k >= skip_from) {
            vec3 voxel = floor(origin + (k + 0.5) * u_step * direction + 0.5);
            float away = brick_distance(voxel);
            skip_from = leap(away, voxel, k, origin, direction, 0.5);
            k = away > 0.0 ? skip_from : k;
        }
        if (k >= range.y)
            break;
        int here = int(label_at(floor(origin + (k + 0.5) * u_step * direction + 0.5)));
        if (here != label) {
            label = here;
            int slot = slots[here];
            if (slot != current) {
                flush(current, samples);
                samples = 0u;
                current = slot;
                if (slot >= 0)
                    meet(slot);
            }
        }
        samples += 1u;
        k += 1.0;
    }
    flush(current, samples);
}
