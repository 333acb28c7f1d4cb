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
    "evaluation/evaluate.py": (*_FIGURES, "evaluation/test_light_record", *_SHARES, *_LIGHT),
    "evaluation/light.py": (
        "evaluation/test_light_record",
        *_FIGURES,
        *_SHARES,
        "evaluation/test_light_figures",
        *_LIGHT,
    ),
    "evaluation/light_bounds.py": (*_FIGURES, *_SHARES, "evaluation/test_light_figures", *_LIGHT),
    "evaluation/limit_result.py": (*_FIGURES, *_SHARES),
    "evaluation/limits.py": (*_FIGURES, *_SHARES, *_LIGHT),
    "evaluation/metrics.py": (*_FIGURES, "evaluation/test_noise_free", "evaluation/test_minimum", *_LIGHT),
    "evaluation/minimum.py": (*_FIGURES, "evaluation/test_minimum"),
    "evaluation/noise_free.py": (*_FIGURES, "evaluation/test_noise_free"),
    "evaluation/preset_error.py": (*_REPLICATES, *_LIGHT),
    "evaluation/receiver_light.py": (*_FIGURES, *_SHARES, *_LIGHT),
    "evaluation/region_light.py": (*_FIGURES, *_SHARES, *_LIGHT),
    "evaluation/replicate_metrics.py": (
        *_FIGURES,
        "evaluation/test_light_record",
        "evaluation/test_noise_free",
        "evaluation/test_minimum",
        *_LIGHT,
    ),
    "evaluation/simulate.py": (*_REPLICATES, "evaluation/test_light_record", *_LIGHT),
    "targets/beams.py": _PICTURES,
    "targets/lettering.py": _PICTURES,
    "targets/limits.py": ("targets/test_limit_places", *_SHARES),
    "targets/pattern.py": _PICTURES,
    "targets/region.py": _PICTURES,
    "targets/shapes.py": _PICTURES,
    "targets/tables.py": _PICTURES,
    "receivers/build.py": ("receivers/test_built_receivers", *_PIXELS),
    "receivers/cylinder.py": (*_PIXELS, "receivers/test_possible"),
    "receivers/far_field.py": (*_PIXELS, "receivers/test_possible"),
    "receivers/pixels.py": _PIXELS,
    "receivers/plane.py": (*_PIXELS, "receivers/test_possible"),
    "receivers/pose.py": _PIXELS,
    "receivers/posed.py": (*_PIXELS, "receivers/test_possible"),
    "receivers/possible.py": (
        "receivers/test_bounds_of_light",
        "receivers/test_nearest_picture",
        "receivers/test_possible",
    ),
    "receivers/receiver.py": (*_PIXELS, "optimisation/test_collect"),
    "receivers/sphere.py": (*_PIXELS, "receivers/test_possible"),
    "far_field/angular_grid.py": (
        "far_field/test_fitted_tables",
        "far_field/test_angular_grid",
        "far_field/test_photometry",
    ),
    "far_field/beam_figures.py": _PHOTOMETRY,
    "far_field/exit_light.py": (
        "far_field/test_exit_light",
        "far_field/test_exit_spectrum",
        *_PHOTOMETRY,
        "sources/test_large_ray_files",
    ),
    "far_field/export.py": ("far_field/test_photometry_record", *_PHOTOMETRY),
    "far_field/files.py": _PHOTOMETRY,
    "far_field/lumens.py": _PHOTOMETRY,
    "far_field/photometry.py": ("far_field/test_photometry_record", *_PHOTOMETRY),
    "far_field/resolution.py": (
        "far_field/test_fitted_tables",
        "far_field/test_interpolation_error",
        "far_field/test_angular_grid",
        "far_field/test_photometry",
    ),
    "far_field/spectrum.py": ("far_field/test_exit_spectrum", *_PHOTOMETRY, "sources/test_large_ray_files"),
    "far_field/sphere.py": _PHOTOMETRY,
    "sources/areas.py": _AREAS,
    "sources/blocks.py": ("sources/test_source_poses", "sources/test_large_ray_files"),
    "sources/build.py": (
        "sources/test_source_poses",
        "sources/test_flux",
        *_AREAS,
        "sources/test_placement",
        *_COLOURS,
    ),
    "sources/bundle.py": ("sources/test_source_poses", *_AREAS, "sources/test_ray_set", "sources/test_large_ray_files"),
    "sources/cavity.py": ("sources/test_cavity",),
    "sources/dispersion.py": _DISPERSED,
    "sources/etendue.py": ("sources/test_light_accounts", "sources/test_source_etendue", "receivers/test_possible"),
    "sources/flux.py": (
        "sources/test_settled_flux",
        "sources/test_flux",
    ),
    "sources/intensity.py": ("sources/test_tabulated_intensity", *_AREAS, "sources/test_photometric"),
    "sources/inverse_cdf.py": _AREAS,
    "sources/luminance.py": _AREAS,
    "sources/measured_rays.py": (
        "sources/test_ray_set_numbers",
        "sources/test_measured_rays",
        "sources/test_large_ray_files",
    ),
    "sources/placement.py": ("sources/test_source_poses", "sources/test_placement", "sources/test_measured_rays"),
    "sources/planar.py": _AREAS,
    "sources/radiance.py": _AREAS,
    "sources/radiance_table.py": ("sources/test_radiance_rays", "sources/test_radiance", "sources/test_source_etendue"),
    "sources/ray_set.py": _RAY_SETS,
    "sources/ray_set_figures.py": _RAY_SETS,
    "sources/ray_set_flux.py": ("sources/test_rayfiles_flux", "sources/test_flux", *_RAY_SETS),
    "sources/ray_set_loading.py": ("sources/test_dispersion_account", *_RAY_SETS),
    "sources/ray_set_outline.py": ("sources/test_outline_of_rays", *_RAY_SETS),
    "sources/rays_of_file.py": _RAY_SETS,
    "sources/source_summary.py": (
        "sources/test_source_poses",
        "sources/test_flux",
        "sources/test_dispersion_account",
        "sources/test_ray_set",
    ),
    "sources/spectrum.py": _COLOURS,
    "sources/spectrum_file.py": ("sources/test_spectrum_files",),
    "sources/square.py": _AREAS,
    "sources/unread_rays.py": (
        "sources/test_ray_set_numbers",
        "sources/test_large_ray_files",
    ),
    "optimisation/adam.py": ("optimisation/test_adam",),
    "optimisation/augmented_lagrangian.py": _FEASIBLE,
    "optimisation/chart_points.py": ("optimisation/test_chart_operators", *_ENVELOPE),
    "optimisation/collect.py": ("optimisation/test_collect",),
    "optimisation/constraints.py": (*_FIELDS, *_ENVELOPE),
    "optimisation/feasibility.py": ("optimisation/test_projection_rounds", *_ENVELOPE),
    "optimisation/image_terms.py": _MERIT,
    "optimisation/keep_out.py": ("optimisation/test_room_for_parts", *_ENVELOPE),
    "optimisation/limit_terms.py": (
        "optimisation/test_terms_by_hand",
        "optimisation/test_limit_terms",
    ),
    "optimisation/limits.py": (*_FIELDS, *_ENVELOPE),
    "optimisation/merit.py": ("optimisation/test_merit_of_samples", *_MERIT, "optimisation/test_limit_terms"),
    "optimisation/source_clearance.py": (
        "optimisation/test_room_for_parts",
        "optimisation/test_source_clearance",
    ),
    "optimisation/surface_shape.py": (
        "optimisation/test_chart_operators",
        "optimisation/test_shape_constraints",
        "optimisation/test_envelope",
    ),
    "optimisation/symmetry.py": (
        "optimisation/test_mirrored_receivers",
        "optimisation/test_terms_by_hand",
        "optimisation/test_symmetry",
        "optimisation/test_limit_terms",
        *_MERIT,
    ),
    "manufacturing/advice.py": (
        "manufacturing/test_advised_changes",
        "manufacturing/test_cutting_advice",
    ),
    "manufacturing/best_fit_sphere.py": ("manufacturing/test_best_fit_sphere",),
    "manufacturing/check.py": ("manufacturing/test_machining_numbers", *_CHECK, "manufacturing/test_tools"),
    "manufacturing/cutter.py": (
        "manufacturing/test_machining_numbers",
        "manufacturing/test_cutter",
        "manufacturing/test_relief",
    ),
    "manufacturing/face.py": _FACE,
    "manufacturing/face_check.py": ("manufacturing/test_machining_numbers", "manufacturing/test_cutter", *_CHECK),
    "manufacturing/findings.py": ("manufacturing/test_findings", "manufacturing/test_draft_finding"),
    "manufacturing/quadrature.py": (
        "manufacturing/test_machining_numbers",
        "manufacturing/test_face",
    ),
    "manufacturing/relief.py": (
        "manufacturing/test_relief_by_contacts",
        "manufacturing/test_custom_base_relief",
        *_CHECK,
        "manufacturing/test_brute_ball",
    ),
    "manufacturing/result.py": _CHECK,
    "manufacturing/scallop.py": (
        "manufacturing/test_machining_numbers",
        "manufacturing/test_scallop",
    ),
    "manufacturing/tools.py": (
        "manufacturing/test_machining_numbers",
        "manufacturing/test_tools",
    ),
}


def files_of(module: str) -> tuple[str, ...]:
    """Tests of a module, each once."""
    return tuple(dict.fromkeys(TESTS[module]))
