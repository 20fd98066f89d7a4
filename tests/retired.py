"""Names and phrases that issue 13 replaced; docs/decisions/0009-the-house.md says by what.

JSON keys of saved sessions, docs/decisions and docs/profiles.md are history and keep theirs.
"""

NAMES = """
BOOK Berth Blocking Borrowed COMPASS CacheBook Card CardsVisual Casters Contents Crop Depicted
Director Disclosure FineCrop FlightPainter Glimpse Glimpses Jobs Ledger LiveShot Outcome Outlook
Pacing PackedLabels PackedPainter Painter Patch PlainStage Pointer Projector Question Sending
SessionCore SessionCriteria SessionDirections SessionGlimpses SessionInquiry SessionLeaving
SessionRepair SessionSight SessionSteps SessionTints Situation SpritePainter Studio Study
Surroundings Survey Tally Unearthing Warming WayOut Workbench Workpiece accept_answer
accept_glimpse accept_hues accept_labels accept_repair accept_reveal accept_survey answer_along
best_way_out cast_crop default_affinity delete_question director free_groups free_ids free_watch
glimpse_question hue_question join_parts judge_by labels_question least_blocked least_unearthing
mark_good merge_question object_patch occlusion_question packed_patch paint_question projector
refine_by_oracle repair_question reveal_question right_of_way shape_cuts skirt split_question
picture_size sprite_patch survey_question take_apart take_in take_off unearthing way_out
written_whole
"""
"""Classes and functions."""

MODULES = """
affinity agglomeration arguments arrow at_rest backdrop binary_step blocks border_features borders
cards cards_adapter caster checks chunks cli_input cli_surroundings clock coarse color_strip
coloring compaction contacts contents convexity corridors counting counts crumpled cut_between
cutting density_candidates departures depicted director distinct_colors entering
evaluation_by_object exports faint field_of_view fields film_files filming films fine_crops
flight_painter gl_backend gliding_bar grainy groups guest halo hands hue_fade imaging inspect_box
inspection interfering interpolation joining keep_framed keys label_colors lanes large
lattice_candidates layer_box ledger linkage live_shots log lost_context marching marks matter
moving neighbours notices objects objects_record occlusion_pass opacity opened_before opening
own_context own_volumes pacing packed packed_labels packed_painter packed_window packets pads
page_parts pages painted_labels parting parts path picture_cache picture_casting picture_options
picture_patch picture_place pictures places pointer posture prepare presets projector pulling
ranking raycasting record recursion refine_by_oracle refining relabelling repair_bench resolving
right_of_way safe_ring sample_data sampled_bits scrub_bar sending session_arrays session_reader
session_stores settings shader_source sharpening sheet_candidates shells shots silhouettes
situation_record skirting slice_hues slice_steps smooth_fields sources split_clicks sprite_glide
sprite_painter sprites stage stage_events steady steering store strokes studio study study_record
supports surroundings_record survey tables tallies thin_things threads tracing transition
tree_candidates vectors view_record voting waiting walking warming ways wires workbench workpiece
"""
"""Packages and modules, by their last name."""

TEXTS = (
    "Unearth",
    "Good objects",
    "on the stage",
    "All free",
    "Outline what is free",
    "who blocks them not",
    "When the network's word is taken",
    "nobody is free",
    "Towards me",
    "Every object is blocked in this direction",
    "No object is unpackable in this direction",
    "must leave first or with it",
    "hidden): it leaves",
    "Unpack just those",
    "atter of no object",
    'QCheckBox("at rest")',
    "Recolour at rest",
    "less than 1 %",
    "Scored by",
    "the default oracle",
    "Frames a second of movies",
    "Fps=",
    "Behind=",
    '("Sure"',
    "sure that this is one whole object",
    "see that object alone",
    "Left as",
)
"""Phrases that the user saw."""
