"""Tests that state the truth of each measured module, in the order in which they run; paths below ``tests``."""

_FIGURES = (
    "evaluation/test_loops_over_replicates",
    "evaluation/test_judgement_figures",
    "evaluation/test_receiver_figures",
)
_REPLICATES = ("evaluation/test_replicates_of_rays",)
_LIGHT = ("evaluation/test_evaluation", "evaluation/test_preset_error", "receivers/test_truths")
_SHARES = ("evaluation/test_judged_limits", "targets/test_limit_readings")
_PIXELS = (
    "receivers/test_landing_places",
    "receivers/test_receiver",
    "receivers/test_plane",
    "receivers/test_posed",
    "targets/test_shapes",
)
_PICTURES = (
    "targets/test_light_at_places",
    "targets/test_patterns_on_pixels",
    "targets/test_light_tables",
    "receivers/test_target_pictures",
    "targets/test_shapes",
    "receivers/test_receiver",
)
_PHOTOMETRY = (
    "far_field/test_exit_light",
    "far_field/test_beam_figures",
    "far_field/test_photometry",
    "far_field/test_photometry_files",
    "roadway/test_road_figures",
)
_AREAS = (
    "sources/test_emitting_areas",
    "sources/test_inverse_distribution",
    "sources/test_drawn_directions",
    "sources/test_radiance_rays",
    "sources/test_planar_sources",
    "sources/test_radiance",
    "sources/test_source_etendue",
)
_COLOURS = (
    "sources/test_light_accounts",
    "sources/test_spectrum_files",
    "sources/test_dispersion",
    "sources/test_dispersion_account",
)
_DISPERSED = (
    "sources/test_light_accounts",
    "sources/test_dispersion_account",
    "sources/test_dispersion",
    "sources/test_measured_rays",
)
_RAY_SETS = (
    "sources/test_ray_set_numbers",
    "sources/test_ray_set",
    "sources/test_measured_rays",
    "sources/test_large_ray_files",
)
_MERIT = (
    "optimisation/test_terms_by_hand",
    "optimisation/test_image_terms",
    "optimisation/test_receivers",
    "receivers/test_receiver",
    "optimisation/test_constraints",
)
_FIELDS = ("optimisation/test_constraint_fields",)
_FEASIBLE = (
    *_FIELDS,
    "optimisation/test_constraints",
    "optimisation/test_feasibility",
    "optimisation/test_shape_constraints",
)
_ENVELOPE = ("optimisation/test_keep_out_balls", *_FEASIBLE, "optimisation/test_envelope")
_FACE = ("manufacturing/test_face", "manufacturing/test_cutter", "geometry/test_wall")
_CHECK = (
    "manufacturing/test_draft_finding",
    "manufacturing/test_cutting_advice",
    "manufacturing/test_relief",
    "manufacturing/test_check",
)

TESTS: dict[str, tuple[str, ...]] = {
    "light/evaluation.py": (*_FIGURES, "evaluation/test_light_record", *_SHARES, *_LIGHT),
    "light/evaluation_result.py": (
        "evaluation/test_light_record",
        *_FIGURES,
        *_SHARES,
        "evaluation/test_light_figures",
        *_LIGHT,
    ),
    "light/receiver_light.py": (*_FIGURES, *_SHARES, "evaluation/test_light_figures", *_LIGHT),
    "light/evaluation_result.py": (*_FIGURES, *_SHARES),
    "light/judged_limits.py": (*_FIGURES, *_SHARES, *_LIGHT),
    "light/metrics.py": (*_FIGURES, "evaluation/test_noise_free", "evaluation/test_minimum", *_LIGHT),
    "light/least_irradiance.py": (*_FIGURES, "evaluation/test_minimum"),
    "light/metrics.py": (*_FIGURES, "evaluation/test_noise_free"),
    "light/evaluation.py": (*_REPLICATES, *_LIGHT),
    "light/receiver_light.py": (*_FIGURES, *_SHARES, *_LIGHT),
    "light/receiver_light.py": (*_FIGURES, *_SHARES, *_LIGHT),
    "light/simulation.py": (
        *_FIGURES,
        "evaluation/test_light_record",
        "evaluation/test_noise_free",
        "evaluation/test_minimum",
        *_LIGHT,
    ),
    "light/simulation.py": (*_REPLICATES, "evaluation/test_light_record", *_LIGHT),
    "scene/target_shapes.py": _PICTURES,
    "scene/target_pattern.py": _PICTURES,
    "scene/limit_readings.py": ("targets/test_limit_places", *_SHARES),
    "scene/target_pattern.py": _PICTURES,
    "scene/target_region.py": _PICTURES,
    "scene/target_shapes.py": _PICTURES,
    "scene/target_pattern.py": _PICTURES,
    "scene/receiver_shapes.py": ("receivers/test_built_receivers", *_PIXELS),
    "scene/receiver_shapes.py": (*_PIXELS, "receivers/test_possible"),
    "scene/receiver_shapes.py": (*_PIXELS, "receivers/test_possible"),
    "scene/pixel_grid.py": _PIXELS,
    "scene/receiver_shapes.py": (*_PIXELS, "receivers/test_possible"),
    "scene/receiver.py": _PIXELS,
    "scene/receiver.py": (*_PIXELS, "receivers/test_possible"),
    "scene/possible_light.py": (
        "receivers/test_bounds_of_light",
        "receivers/test_nearest_picture",
        "receivers/test_possible",
    ),
    "scene/receiver.py": (*_PIXELS, "optimisation/test_collect"),
    "scene/receiver_shapes.py": (*_PIXELS, "receivers/test_possible"),
    "light/angular_grid.py": (
        "far_field/test_fitted_tables",
        "far_field/test_angular_grid",
        "far_field/test_photometry",
    ),
    "light/photometry_result.py": _PHOTOMETRY,
    "light/exit_light.py": (
        "far_field/test_exit_light",
        "far_field/test_exit_spectrum",
        *_PHOTOMETRY,
        "sources/test_large_ray_files",
    ),
    "light/photometry_export.py": ("far_field/test_photometry_record", *_PHOTOMETRY),
    "light/photometry_export.py": _PHOTOMETRY,
    "light/source_photometry.py": _PHOTOMETRY,
    "light/photometry_result.py": ("far_field/test_photometry_record", *_PHOTOMETRY),
    "light/angular_resolution.py": (
        "far_field/test_fitted_tables",
        "far_field/test_interpolation_error",
        "far_field/test_angular_grid",
        "far_field/test_photometry",
    ),
    "light/source_photometry.py": ("far_field/test_exit_spectrum", *_PHOTOMETRY, "sources/test_large_ray_files"),
    "light/exit_light.py": _PHOTOMETRY,
    "sources/emitting_area.py": _AREAS,
    "sources/ray_bundle.py": ("sources/test_source_poses", "sources/test_large_ray_files"),
    "sources/build_source.py": (
        "sources/test_source_poses",
        "sources/test_flux",
        *_AREAS,
        "sources/test_placement",
        *_COLOURS,
    ),
    "sources/ray_bundle.py": (
        "sources/test_source_poses",
        *_AREAS,
        "sources/test_ray_set",
        "sources/test_large_ray_files",
    ),
    "sources/build_source.py": ("sources/test_cavity",),
    "sources/dispersion.py": _DISPERSED,
    "scene/possible_light.py": (
        "sources/test_light_accounts",
        "sources/test_source_etendue",
        "receivers/test_possible",
    ),
    "sources/source_flux.py": (
        "sources/test_settled_flux",
        "sources/test_flux",
    ),
    "sources/intensity.py": ("sources/test_tabulated_intensity", *_AREAS, "sources/test_photometric"),
    "sources/inverse_cdf.py": _AREAS,
    "sources/planar_emitter.py": _AREAS,
    "sources/measured_rays.py": (
        "sources/test_ray_set_numbers",
        "sources/test_measured_rays",
        "sources/test_large_ray_files",
    ),
    "sources/source_pose.py": ("sources/test_source_poses", "sources/test_placement", "sources/test_measured_rays"),
    "sources/planar_emitter.py": _AREAS,
    "sources/radiance_emitter.py": _AREAS,
    "sources/radiance_emitter.py": (
        "sources/test_radiance_rays",
        "sources/test_radiance",
        "sources/test_source_etendue",
    ),
    "sources/ray_set.py": _RAY_SETS,
    "sources/ray_set_figures.py": _RAY_SETS,
    "sources/ray_set_figures.py": ("sources/test_rayfiles_flux", "sources/test_flux", *_RAY_SETS),
    "sources/ray_set_loading.py": ("sources/test_dispersion_account", *_RAY_SETS),
    "sources/ray_set.py": ("sources/test_outline_of_rays", *_RAY_SETS),
    "sources/ray_set_loading.py": _RAY_SETS,
    "sources/source_summary.py": (
        "sources/test_source_poses",
        "sources/test_flux",
        "sources/test_dispersion_account",
        "sources/test_ray_set",
    ),
    "sources/source_spectrum.py": _COLOURS,
    "sources/source_spectrum.py": ("sources/test_spectrum_files",),
    "sources/build_source.py": _AREAS,
    "sources/ray_bundle.py": (
        "sources/test_ray_set_numbers",
        "sources/test_large_ray_files",
    ),
    "search/search_state.py": ("optimisation/test_adam",),
    "search/constraints.py": _FEASIBLE,
    "search/constraint_points.py": ("optimisation/test_chart_operators", *_ENVELOPE),
    "search/light_path.py": ("optimisation/test_collect",),
    "search/constraints.py": (*_FIELDS, *_ENVELOPE),
    "search/feasibility.py": ("optimisation/test_projection_rounds", *_ENVELOPE),
    "search/merit_terms.py": _MERIT,
    "search/keep_out_extent.py": ("optimisation/test_room_for_parts", *_ENVELOPE),
    "search/merit_terms.py": (
        "optimisation/test_terms_by_hand",
        "optimisation/test_limit_terms",
    ),
    "search/design_result.py": (*_FIELDS, *_ENVELOPE),
    "search/merit.py": ("optimisation/test_merit_of_samples", *_MERIT, "optimisation/test_limit_terms"),
    "search/source_clearance.py": (
        "optimisation/test_room_for_parts",
        "optimisation/test_source_clearance",
    ),
    "search/constraint_points.py": (
        "optimisation/test_chart_operators",
        "optimisation/test_shape_constraints",
        "optimisation/test_envelope",
    ),
    "search/symmetry.py": (
        "optimisation/test_mirrored_receivers",
        "optimisation/test_terms_by_hand",
        "optimisation/test_symmetry",
        "optimisation/test_limit_terms",
        *_MERIT,
    ),
    "shop/findings.py": (
        "manufacturing/test_advised_changes",
        "manufacturing/test_cutting_advice",
    ),
    "shop/best_fit_sphere.py": ("manufacturing/test_best_fit_sphere",),
    "shop/check.py": ("manufacturing/test_machining_numbers", *_CHECK, "manufacturing/test_tools"),
    "shop/ball_cutter.py": (
        "manufacturing/test_machining_numbers",
        "manufacturing/test_cutter",
        "manufacturing/test_relief",
    ),
    "shop/face_samples.py": _FACE,
    "shop/face_check.py": ("manufacturing/test_machining_numbers", "manufacturing/test_cutter", *_CHECK),
    "shop/findings.py": ("manufacturing/test_findings", "manufacturing/test_draft_finding"),
    "shop/face_samples.py": (
        "manufacturing/test_machining_numbers",
        "manufacturing/test_face",
    ),
    "shop/ball_clearance.py": (
        "manufacturing/test_relief_by_contacts",
        "manufacturing/test_custom_base_relief",
        *_CHECK,
        "manufacturing/test_brute_ball",
    ),
    "shop/check_result.py": _CHECK,
    "shop/ball_cutter.py": (
        "manufacturing/test_machining_numbers",
        "manufacturing/test_scallop",
    ),
    "shop/tool_reach.py": (
        "manufacturing/test_machining_numbers",
        "manufacturing/test_tools",
    ),
}


def files_of(module: str) -> tuple[str, ...]:
    """Tests of a module, each once."""
    return tuple(dict.fromkeys(TESTS[module]))
