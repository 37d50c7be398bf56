#!/usr/bin/env bash
"exec" "bash" "-c" '. "${0%/*}/setup.sh"; exec "$PYTHON" "$0" "$@"' "$0" "$@"  # to Python, a string

__doc__ = """A mutation study: important lines are made wrong, one at a time, and a test must fail each time.

    scripts/mutation.py [--only WORD]

Works in a copy of the checkout. First the tests must pass without a mutant. Prints the table of
docs/tables/mutation.md. Exit code 1 if a mutant survives, 2 if the study itself is wrong: a text that is not there
exactly once, a test that fails by itself, a mutant that cannot be imported.
"""

import argparse
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]

LIMIT = 120.0
"""Seconds after which a test counts as failed; mutants may make it hang."""


class Mutant(NamedTuple):
    """A `text` that occurs once in the file `ddmpi/{file}.py`, its replacement, and the tests `tests/{test}`."""

    name: str
    file: str
    text: str
    replacement: str
    tests: str


CERTIFICATE = "judge/test_certificate.py"
SPOILT = f"{CERTIFICATE}::test_a_wrong_answer_has_the_residual_of_its_error"
SOLVED = f"{CERTIFICATE}::test_a_solved_scene_that_is_spoilt_is_not_certified"
STATE = "methods/test_steps.py::test_newton_goes_on_from_its_whole_state"
RESTORED = "run/test_checkpoint.py::test_a_restored_state_is_the_whole_state"
SKFEM = "body/test_elasticity.py::test_stiffness_is_that_of_skfem"
RANDOM = "qp/test_mprgp.py::test_random_programs"
LAW, SIDES, LEGS = "interface/test_law.py", "interface/test_interface.py", "coupling/test_exchange.py"
MEMBER, MORTAR = "coupling/test_member.py", "interface/test_mortar.py"
ANSWER, NODES = "run/test_answer.py", f"{CERTIFICATE}::test_the_state_of_the_nodes"

MUTANTS = [Mutant(*row) for row in (
    # petsc, system
    ("norm of an operator stops early", "petsc/lanczos", "abs(norm - previous) <= change * norm", "norm > 0.0",
     "qp/test_mprgp.py::test_estimate_norm_is_a_little_too_small"),
    ("an error is not agreed on", "system/agreement", "        error = failure\n", "        del failure\n",
     f"{LEGS}::test_agreed_raises_the_first_error_on_all_ranks"),
    ("a file is written in place", "system/files",
     'path.with_name(f"{UNFINISHED}-{socket.gethostname()}-{os.getpid()}-{path.name}")', "path",
     "results/test_files.py::test_a_file_that_cannot_be_written_leaves_the_former_one"),
    ("a signal is not noted", "system/interrupt", "    _received.append(signal.Signals(number).name)\n", "    pass\n",
     "run/test_checkpoint.py::test_signals_are_noted_and_not_deadly"),
    # scene
    ("unknown keys are accepted", "scene/values", "forbid_unknown_fields=True", "forbid_unknown_fields=False",
     "scene/test_scene.py::test_refusal_names_file_key_and_remedy"),
    ("infinite numbers are accepted", "scene/values",
     "Number = Annotated[float, msgspec.Meta(ge=-LARGEST, le=LARGEST)]", "Number = float",
     "scene/test_scene.py::test_numbers_are_finite"),
    ("affine values mix x and y", "scene/values", "(value.y_slope, y))", "(value.y_slope, x))",
     "scene/test_scene.py::test_evaluate_keeps_shape"),
    ("wrong first Lamé constant", "scene/bodies", "first = E * nu / ((1 + nu) * (1 - 2 * nu))",
     "first = E * nu / ((1 + nu) * (1 - nu))", "scene/test_scene.py::test_lame_constants"),
    ("plane stress as plane strain", "scene/bodies", 'if self.plane == "stress":', "if False:",
     "scene/test_scene.py::test_lame_constants"),
    ("the outer tolerance forgets the target", "scene/method", "enough *= min(theta, 1.0)", "pass",
     "judge/test_accuracy.py::test_the_published_iteration_stops_later_for_a_target"),
    # mesh
    ("clockwise triangles stay", "mesh/read", "triangles[turned] = triangles[turned][:, [0, 2, 1]]", "pass",
     "mesh/test_mesh.py::test_clockwise_triangles_are_turned"),
    ("curved sides are straightened", "mesh/read", "np.where((far & (triangles", "np.where((False & far & (triangles",
     "mesh/test_mesh.py::test_curved_triangles"),
    ("clockwise triangles mix up their middles", "mesh/read", "bends[turned] = bends[turned][:, [2, 1, 0]]", "pass",
     "mesh/test_curved_meshes.py::test_turned_triangles_keep_their_middles"),
    ("edges are not turned outward", "mesh/boundary",
     "return np.where(forward[:, None], edges, edges[:, [1, 0, *range(2, edges.shape[1])]])", "return edges",
     "mesh/test_mesh.py::test_edges_are_turned_and_walked"),
    ("a halved triangle is turned over", "mesh/refine", "[ab, bc, ca]]", "[ab, ca, bc]]",
     "judge/test_accuracy.py::test_halved_mesh"),
    ("wrong quadrature weight", "mesh/elements", "c, c) / len(c)", "c, c) / 3", SKFEM),
    ("loads of quadratic sides go to their ends", "mesh/elements", "np.array([[1, 0], [0, 1], [2, 2]]) / 6",
     "np.array([[3, 0], [0, 3], [0, 0]]) / 6", "body/test_elasticity.py::test_load_is_the_integral"),
    ("the map of curved triangles is turned", "mesh/elements", "np.subtract(second * x1, first * x2",
     "np.subtract(first * x1, second * x2", "body/test_curved_bodies.py::test_linear_displacement_is_exact"),
    ("folded triangles are accepted", "mesh/mesh", "if (least <= 0.0).any():", "if (least <= -9.0).any():",
     "mesh/test_curved_meshes.py::test_folded_triangle_is_refused"),
    # body
    ("loads of clamped dofs are not eliminated", "body/elasticity", "(right[nodes] * loose).ravel()",
     "right[nodes].ravel()", "body/test_elasticity.py::test_clamps_against_elimination_by_scipy"),
    ("clamped dofs stay coupled", "body/stiffness", "upper *= loose[a][:, :, None] & loose[b][:, None, :]", "pass",
     "body/test_elasticity.py::test_clamps_against_elimination_by_scipy"),
    ("prescribed displacements take no force", "body/elasticity", "f if taken is None else f - taken", "f",
     "body/test_elasticity.py::test_patch_with_prescribed_boundary"),
    ("shear modulus counted once", "body/stiffness", "(first + 2 * shear) * xx + shear * yy",
     "(first + shear) * xx + shear * yy", SKFEM),
    ("a loose piece is accepted", "body/rigid_motions", "if left.size:", "if left.size > 9:",
     "body/test_elasticity.py::test_piece_that_no_clamp_holds_is_refused"),
    ("a contact that does not see a motion counts on rounding", "body/rigid_motions", "values > SEEN *",
     "values > 0.0 *", "body/test_loose.py::test_contact_that_does_not_see_a_motion"),
    ("a load is not balanced by contact forces", "body/rigid_motions", "return f - self._B_transposed",
     "return f; f - self._B_transposed", f"{MEMBER}::test_loose_body_against_dense_algebra"),
    ("no stress across the plane", "body/stress", "zz = material.poisson * (xx + yy) if", "zz = 0.0 * (xx + yy) if",
     "body/test_elasticity.py::test_stress_of_a_linear_field"),
    ("von Mises with too little shear", "body/stress", "+ 3 * xy**2", "+ xy**2",
     "body/test_elasticity.py::test_von_mises"),
    ("error without its square root", "body/estimate", "return float(np.sqrt(squared_error / size)) if size",
     "return float(squared_error / size) if size", "body/test_estimate.py::test_relative_error"),
    ("precision of inner solves ignored", "body/solver", "precision = max(relative or usual, LEAST)",
     "precision = usual", "body/test_solvers.py::test_an_iterative_solve_is_no_more_precise_than_it_is_asked_to_be"),
    ("true residual unchecked", "body/solver", "if residual <= target * size or", "if True or",
     "body/test_solvers.py::test_large_true_residual_is_an_error"),
    ("products by a dense matrix not counted in n_A", "body/compliance",
     "                self.count[purpose] += 1\n                y[:]", "                y[:]",
     "body/test_solvers.py::test_compliance_counts_by_purpose"),
    ("solves not counted in n_A", "body/compliance",
     "        self.count[purpose] += 1\n        self.solver", "        self.solver",
     "body/test_solvers.py::test_compliance_counts_by_purpose"),
    # interface
    ("normals not averaged along a side", "interface/side", "np.add.at(normal, column, outward)",
     "normal[column] = outward", f"{SIDES}::test_side_around_a_corner_averages_normals_by_length"),
    ("nodes at the ends have a whole edge", "interface/side", "length[nodes], free",
     "np.maximum(length[nodes], length[nodes].mean()), free", f"{SIDES}::test_side_of_a_rectangle"),
    ("integrals of curved sides along their chords", "interface/cover", "weight * ratio", "weight",
     "interface/test_curved_sides.py::test_points_that_face_each_other_lie_on_one_ray"),
    ("gaps of curved sides are those of parabolas", "interface/side", "- self.heights[links] * across", "",
     "interface/test_curved_sides.py::test_gap_between_curved_sides_is_that_of_the_circles"),
    ("normals of the second side ignored", "interface/matching", "normal = first.normal - second.normal[match]",
     "normal = 2 * first.normal", f"{SIDES}::test_area_and_normal_are_those_of_both_sides"),
    ("areas of the second side ignored", "interface/matching", "(first.area + second.area[match]) / 2", "first.area",
     f"{SIDES}::test_area_and_normal_are_those_of_both_sides"),
    ("initial gap ignored", "interface/matching", 'gap = np.einsum("ij,ij->i", offset, normal)',
     "gap = np.zeros(len(match))", f"{SIDES}::test_gap_and_overlap"),
    ("clamped neighbours forgotten", "interface/matching", "        to = dropped[neighbour]\n",
     "        to = np.zeros(len(node), bool)\n", f"{SIDES}::test_clamped_nodes_drop_out"),
    ("arcs of curved sides ignored", "interface/cover",
     "slave.bulge(link, at, ray)", "0.0",
     f"{MORTAR}::test_arcs_of_circles_have_their_true_gap"),
    ("sides seen through the slave", "interface/cover",
     "seen = ~_hidden(own, fans, on[piece], middle[piece], distance)", "seen = np.ones(len(piece), bool)",
     f"{MORTAR}::test_the_far_side_of_a_ring_is_no_partner"),
    ("slave chosen by spacing alone", "interface/mortar", "/ (side.links.shape[1] - 1) / side.modulus)",
     "/ (side.links.shape[1] - 1))", f"{MORTAR}::test_the_slave_is_coarse_and_soft"),
    ("held rows like others", "interface/mortar", "motion=motion if motion.min() < 1.0 else None,", "motion=None,",
     f"{MORTAR}::test_clamped_nodes_keep_their_rows"),
    ("closed chains left open", "methods/half_plane",
     "self._around[node, np.arange(len(node))] = sign * np.sqrt(inverse[whole] / length[node])", "pass",
     "methods/test_newton.py::test_half_plane_stiffness_of_a_closed_chain"),
    ("sign of the second body's trace", "interface/trace", "return 1.0 if side == 0 else -1.0", "return 1.0",
     f"{SIDES}::test_displacement_trace_has_the_signs_of_the_slides"),
    ("slip bound without area", "interface/law", "values(friction.slip_bound) * area[sliding]",
     "values(friction.slip_bound)", LAW),
    ("tangential forces not shortened", "interface/law",
     "return np.concatenate([pressure, shorten(tangential, self.slip_bound(pressure)).ravel()])",
     "return np.concatenate([pressure, tangential.ravel()])", LAW),
    ("slip bound does not follow the pressure in a step", "interface/law",
     "(active.slip * slope[:, None]).ravel(), given)", "(0.0 * active.slip).ravel(), given)", LAW),
    ("slip bounds change with the pressure of another node", "interface/law",
     "return self.coefficient * pressure[self.sliding]", "return self.coefficient * pressure[:len(self.sliding)]", LAW),
    ("final gap without the initial one", "interface/state", "interface.gap - moved[0], slip", "-moved[0], slip",
     NODES),
    ("status: slip is called stick", "interface/state", 'status[sliding[law.reaches_bound(s, bound)]] = "slip"', "pass",
     NODES),
    ("status: open is called slip", "interface/state", 'status[~law.closed(s, CLOSED)] = "open"', "pass", NODES),
    ("sign of the force", "interface/state", 'return -np.einsum("mc,mcd->md"', 'return np.einsum("mc,mcd->md"', NODES),
    ("sign of the moment", "interface/state", "return x * fy - y * fx", "return y * fx - x * fy",
     NODES),
    ("pressure not divided by area", "interface/state", "return self.normal_force / self.interface.area",
     "return self.normal_force", NODES),
    # qp
    ("projected gradient without chopping", "qp/box", "p = np.where(x <= self.lower, np.minimum(g, 0.0), g)", "p = g",
     "qp/test_box.py::test_gradient_is_split_by_what_the_bounds_hold"),
    ("proportioning beyond the opposite bound", "qp/mprgp",
     "min(dot(g, chopped) / curvature, least(feasible.longest_step(x, chopped)))",
     "dot(g, chopped) / curvature", RANDOM),
    ("gradient not updated", "qp/mprgp", "g -= step * Hp", "g -= 0.9 * step * Hp", RANDOM),
    ("QPs end too early", "qp/tao", "gatol=tolerance / problem.displacement", "gatol=1e-3", RANDOM),
    ("a QP that failed is accepted", "qp/tao", "if not result.residual <= max(1.01 * tolerance, rounding):",
     "if False:", "qp/test_mprgp.py::test_iteration_limit_from_the_options"),
    # coupling
    ("a loose body's compliance is not centred", "coupling/member", "y[:] = self._centring.project(y)", "pass",
     f"{MEMBER}::test_nothing_depends_on_the_supports"),
    ("an imbalance is hidden", "coupling/member", "Au.axpy(-1.0, f)", "Au.axpy(-1.0, load)",
     f"{MEMBER}::test_residual_sees_an_imbalance"),
    ("rigid motions left out of the displacement", "coupling/member",
     "if alpha is None else full + self.motions @ alpha", "if True else full",
     f"{MEMBER}::test_displacement_of_a_loose_body"),
    ("order of the roles swapped in one place", "coupling/exchange",
     "theirs = receive[2:]\n        return (mine, theirs) if", "theirs = receive[2:]\n        return (theirs, mine) if",
     f"{LEGS}::test_swap_returns_the_first_bodys_vector_first"),
    ("error of the other rank not raised", "coupling/exchange", "if flags & FAILED or lost:", "if lost:",
     f"{LEGS}::test_deferred_error_of_one_of_two_is_raised_on_both"),
    ("error of another rank not raised", "coupling/exchange", "if words[0] or words[2] != -words[3]:",
     "if words[2] != -words[3]:", f"{LEGS}::test_deferred_error_of_one_rank_is_raised_on_all"),
    ("two ranks at different points not noticed", "coupling/exchange",
     "lost = send[1] != receive[1] or len(send) != len(receive)", "lost = False",
     f"{LEGS}::test_ranks_at_different_points_notice_it_whatever_they_send"),
    ("ranks at different points not noticed", "coupling/exchange", "if words[0] or words[2] != -words[3]:",
     "if words[0]:", f"{LEGS}::test_ranks_at_different_points_notice_it"),
    ("a checkpoint is due on one rank only", "coupling/exchange", "self.checkpoint_due |= bool(words[1])", "pass",
     f"{LEGS}::test_all_ranks_learn_that_one_wants_a_checkpoint"),
    ("contributions of the second body taken for the first's", "coupling/exchange", "both[1][owned] = came",
     "both[0][owned] = came", f"{LEGS}::test_both_bodies_contributions_come_to_the_owner"),
    ("a body takes all it gets from the same place", "coupling/exchange",
     "                start += _length(part)\n", "",
     f"{LEGS}::test_each_body_sees_its_part_of_every_interface"),
    ("bytes of a swap not counted", "coupling/exchange", "self.bytes += send.nbytes", "self.bytes += mine.nbytes",
     f"{LEGS}::test_swap_returns_the_first_bodys_vector_first"),
    ("bytes of a message not counted", "coupling/exchange",
     "self.bytes += sum(vector.nbytes for", "self.bytes += sum(1 for",
     f"{LEGS}::test_messages_and_bytes_of_vectors_are_counted"),
    ("initial gap with the wrong sign", "coupling/joint", "self.d = self.d - self.space.gap",
     "self.d = self.d + self.space.gap",
     "coupling/test_joint.py::test_products_and_free_gaps_are_sums_over_the_bodies"),
    ("friction forgets", "run/steps", "start = self._slip_begins(time)", "start = np.zeros(joint.size)",
     "run/test_load_steps.py::test_friction_remembers_how_it_was_sheared"),
    ("gaps computed afresh forget", "run/steps", "joint.begin_slip(start)", "pass",
     "run/test_load_steps.py::test_forces_of_a_history_are_not_those_of_its_end"),
    ("a cut step does not come back", "run/steps", "self._ahead.insert(0, (self._now.time + time) / 2)",
     "self._ahead[0] = (self._now.time + time) / 2",
     "run/test_load_steps.py::test_a_step_that_fails_is_halved_from_the_state_before"),
    ("multiplications of a step not counted", "coupling/joint", "member.C.count.total() for member in", "0 for _ in",
     f"{ANSWER}::test_gaps_close_and_multiplications_are_counted_step_by_step"),
    ("products always at their usual precision", "coupling/joint",
     "relative = min(self.neglected / size, STEERING) if size else 0.0", "relative = 0.0",
     "coupling/test_joint.py::test_a_product_that_is_kept_is_as_precise_as_matters"),
    ("prescribed displacements do not reach the contact", "coupling/member",
     "return h + self.trace(case.prescribed),", "return h,",
     f"{ANSWER}::test_a_clamp_on_the_contact_moves_it"),
    ("equilibrium set to zero", "coupling/member", "Au.norm(), size", "0.0, size", SOLVED),
    # methods
    ("no line search in Newton", "methods/newton",
     "length = 1.0 if self._start else self._length(change, r_change, left)",
     "length = 1.0", "methods/test_steps.py::test_no_step_makes_the_residual_larger"),
    ("the shortest step instead of the best", "methods/newton",
     "return min(zip([full, *there(LENGTHS[1:])], LENGTHS, strict=True))[1]",
     "return LENGTHS[-1]",
     "methods/test_steps.py::test_the_full_step_is_taken_where_it_gains_and_the_best_one_elsewhere"),
    ("`stalled` left out of checkpoints", "methods/newton", 'self._stalled, self.inner_steps = int(state["stalled"])',
     "self._stalled, self.inner_steps = 0", STATE),
    ("`relaxation` left out of checkpoints", "methods/rescue",
     'self._relaxation, self._change = float(state["relaxation"])',
     "self._relaxation, self._change = 1.0", STATE),
    ("`smallest` left out of Anderson's checkpoints", "methods/anderson",
     'self._smallest = float(state["smallest"])', "self._smallest = np.inf", RESTORED),
    ("`step_size` left out of checkpoints", "methods/published", 'self._step_size = float(state["step_size"])', "pass",
     RESTORED),
    ("preconditioner ignores a clamped neighbour", "methods/half_plane", " + interface.held / length", "",
     "methods/test_newton.py::test_half_plane_stiffness_of_one_node"),
    ("preconditioner twice too stiff", "methods/half_plane", "self._scale = 0.5 * interface.modulus",
     "self._scale = interface.modulus", "methods/test_newton.py::test_half_plane_stiffness_of_one_node"),
    ("bounds of the other role", "methods/subproblem", "if role != self.role]", "if role == self.role]",
     "methods/test_subproblem.py::test_each_role_has_the_bounds_of_the_algorithm"),
    ("published iteration ignores the gap", "methods/subproblem", "d[self._normal] -= self.interface.gap", "pass",
     "methods/test_subproblem.py::test_the_second_role_takes_the_gap"),
    # judge
    ("force mismatch set to zero", "judge/certificate",
     "force_mismatch=_ratio(norm(mismatch), max(norm(s), norm(s + mismatch), floor)),", "force_mismatch=0.0,", SPOILT),
    ("penetration set to zero", "judge/certificate", "penetration=_ratio(overlap, U)", "penetration=0.0", SPOILT),
    ("complementarity set to zero", "judge/certificate", "complementarity=complementarity,", "complementarity=0.0,",
     SPOILT),
    ("tension not seen", "judge/certificate", "_ratio(tension, max(S, floor))", "0.0", SPOILT),
    ("friction set to zero", "judge/certificate", "friction=_ratio(friction, size))", "friction=0.0)", SPOILT),
    ("slip not looked at", "judge/certificate", "_ratio(size, U) if S or U else 0.0)", "0.0)", SPOILT),
    ("a residual that is no number passes", "judge/certificate", "if not value <= limit]", "if value > limit]",
     f"{CERTIFICATE}::test_no_answer_with_a_number_that_is_none_is_certified"),
    ("a residual that is no number is not the worst", "judge/certificate",
     "np.inf if np.isnan(values[name]) else values[name])", "values[name])",
     f"{CERTIFICATE}::test_no_answer_with_a_number_that_is_none_is_certified"),
    ("certificates flattered by a rigid motion", "judge/certificate",
     "U = max(min(U, max(yielding, overlap)), RESOLVED * moved,", "U = max(U, RESOLVED * moved,",
     f"{CERTIFICATE}::test_displacements_are_compared_with_what_the_forces_cause"),
    ("a large tolerance empties the certificate", "judge/certificate",
     "min(max(FACTOR * tolerance, SMALLEST_LIMIT), LARGEST_LIMIT)", "max(FACTOR * tolerance, SMALLEST_LIMIT)",
     f"{CERTIFICATE}::test_the_limit_follows_the_tolerance_within_bounds"),
    ("no caution with an estimate", "judge/accuracy", "CAUTION[self.scene.body[0].mesh.order] * target", "target",
     "judge/test_accuracy.py::test_an_estimate_meets_a_target_with_some_caution"),
    ("cycles not seen", "judge/diagnosis", "return bool(same) and any(", "return False and any(",
     "methods/test_newton.py::test_status_log"),
    # results
    ("n_A of the first body only", "results/summary", "n_A, m = sum(body.n_A for body in bodies)",
     "n_A, m = sum(body.n_A for body in bodies[:1])",
     "results/test_summary.py::test_sums_are_those_of_all_bodies_and_contacts"),
    ("nodes that stick dissipate", "interface/state", 'moves = self.status != "stick"',
     'moves = self.status != ""', "results/test_summary.py::test_only_nodes_that_move_dissipate"),
    ("the worst residual is the last one", "results/summary", "return float(np.max(values)) if len(values)",
     "return float(values[-1]) if len(values)", "results/test_summary.py::test_the_worst_residual_is_at_the_top"),
    ("sides' means not by Simpson's rule", "results/tables", "4 * stress[middle] + stress[end]) / 6",
     "stress[middle] + stress[end]) / 3",
     "results/test_tables.py::test_means_over_sides_carry_the_force_of_quadratic_elements"),
    ("the summary is published first", "results/folder", "(name == SUMMARY, name)", "(name != SUMMARY, name)",
     "results/test_files.py::test_what_is_written_is_published"),
    ("results published incompletely", "results/folder", "            for name in names:\n",
     "            for name in names[1:]:\n", "results/test_files.py::test_what_is_written_is_published"),
    ("results overwritten", "results/folder", "            if taken:\n", "            if False:\n",
     "results/test_files.py::test_publishing_overwrites_nothing"),
    ("cells of the second body have the first one's nodes", "results/fields", "fields.triangles + before[0]",
     "fields.triangles", "results/test_fields.py::test_meshio_reads_all_bodies"),
    # run
    ("digest of a checkpoint unchecked", "run/checkpoint", "if data[:BLOCK] != _head(data[BLOCK:]):",
     "if not data.startswith(FORMAT):",
     "run/test_checkpoint.py::test_every_damaged_byte_is_noticed"),
    ("options of another run accepted", "run/checkpoint", 'differing and what != "versions":',
     'differing and what == "scene":',
     "run/test_checkpoint.py::test_another_run_is_refused_with_the_reason"),
    ("a checkpoint of another mesh accepted", "run/checkpoint",
     'if self._begin["mesh"] != self._fixed["mesh"]:', "if False:",
     "run/test_checkpoint.py::test_another_mesh_is_refused_on_both_ranks"),
    ("sign of the reactions", "run/gather", "reaction=-(member", "reaction=(member",
     f"{ANSWER}::test_reactions_of_the_clamps_balance_the_contact"),
    ("certified although the certificate fails", "run/solve",
     'return self.stopped == "converged" and not self.violations', 'return self.stopped == "converged"', SOLVED),
    ("certified although the iteration did not end", "run/solve",
     'return self.stopped == "converged" and not self.violations', "return not self.violations", SOLVED),
    ("equilibrium of the certificate is another body's", "run/solve",
     'equilibrium_residual(bodies[name]["left"],', 'equilibrium_residual(bodies[names[0]]["left"],', SOLVED),
    ("brute force's answer not compared", "cli/verify", "if not (solution.certified and distance <= solution.limit):",
     "if not solution.certified:", "methods/test_newton.py::test_verify_refuses_an_answer_that_is_off"),
    # sweep
    ("failed cases are not run again", "sweep/sweep", "if outcome.summary is None]",
     'if outcome.status in ("not run", "interrupted")]',
     "sweep/test_sweep.py::test_again_only_what_has_no_results"),
    ("another sweep's folder accepted", "sweep/table", "    if differing:\n", "    if False:\n",
     "sweep/test_sweep_folder.py::test_mesh_files_are_part_of_a_sweep"),
    ("shares overlap", "sweep/cases", "return cases[int(match[1])::step]", "return cases[int(match[1]):]",
     "sweep/test_cases.py::test_shares_cover_everything_once"),
    ("uncertified cases are called certified", "sweep/table", '"exit": 0 if summary["converged"] else 3', '"exit": 0',
     "sweep/test_sweep.py::test_failing_cases_do_not_stop_the_others"),
)]


class Checkout:
    """A copy of the checkout in `folder`, in which tests run one after another."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "ddmpi"
        for name in ("ddmpi", "tests", "scripts", "configs", "meshes", "docs"):
            shutil.copytree(ROOT / name, self.folder / name, ignore=shutil.ignore_patterns("__pycache__"))
        for file in ROOT.glob("*.*"):
            if file.is_file():
                shutil.copy(file, self.folder)
        # Without bytecode: a mutant of the same size, made in the same second, would not be noticed.
        self._environment = os.environ | {"PYTHONPATH": str(self.folder), "PYTHONDONTWRITEBYTECODE": "1",
                                          "MPLBACKEND": "agg"}

    def test(self, names: list[str], limit: float = LIMIT) -> tuple[int | None, str]:
        """Exit code of pytest (None where it took too long), and its output."""
        command = [sys.executable, "-m", "pytest", "-x", "-p", "no:cacheprovider",
                   *(f"tests/{name}" for name in names)]
        with subprocess.Popen(command, cwd=self.folder, env=self._environment, start_new_session=True, text=True,
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as child:
            try:
                output, _ = child.communicate(timeout=limit)
            except subprocess.TimeoutExpired:
                os.killpg(child.pid, signal.SIGKILL)
                return None, child.communicate()[0]
            return child.returncode, output

    def try_mutant(self, mutant: Mutant) -> tuple[int | None, str]:
        path = self.folder / "ddmpi" / f"{mutant.file}.py"
        original = path.read_text(encoding="utf-8")
        path.write_text(original.replace(mutant.text, mutant.replacement), encoding="utf-8")
        try:
            return self.test([mutant.tests])
        finally:
            path.write_text(original, encoding="utf-8")


def wrong_texts(mutants: list[Mutant]) -> list[str]:
    """What is wrong with the table itself."""
    counts = [(ROOT / "ddmpi" / f"{mutant.file}.py").read_text(encoding="utf-8").count(mutant.text)
              for mutant in mutants]
    return [f"{mutant.name}: the text is {count} times in ddmpi/{mutant.file}.py"
            for mutant, count in zip(mutants, counts, strict=True) if count != 1]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--only", default="", metavar="WORD", help="mutants with this word in name, file or tests")
    word = parser.parse_args().only
    mutants = [mutant for mutant in MUTANTS if any(word in part for part in (mutant.name, mutant.file, mutant.tests))]
    wrong = wrong_texts(mutants) or ([] if mutants else [f"no mutant has the word {word!r}"])
    if wrong:
        print("\n".join(wrong), file=sys.stderr)
        return 2
    survivors = 0
    with tempfile.TemporaryDirectory() as folder:
        checkout = Checkout(Path(folder))
        code, output = checkout.test(sorted({mutant.tests for mutant in mutants}), 10 * LIMIT)
        if code != 0:
            print(output, "these tests fail without a mutant", sep="\n", file=sys.stderr)
            return 2
        print("| in `ddmpi/` | mutant | test in `tests/` | caught in s |", "|---|---|---|---|", sep="\n", flush=True)
        for mutant in mutants:
            start = time.monotonic()
            code, output = checkout.try_mutant(mutant)
            if code not in (0, 1, None):
                print(output, f"{mutant.name}: pytest ended with {code}", sep="\n", file=sys.stderr)
                return 2
            survivors += code == 0
            end = "SURVIVED" if code == 0 else f"{time.monotonic() - start:.1f}" + " (time limit)" * (code is None)
            print(f"| {mutant.file}.py | {mutant.name} | {mutant.tests.replace('::', ': ')} | {end} |", flush=True)
    print(f"\n{len(mutants) - survivors} of {len(mutants)} mutants are caught.")
    return int(survivors > 0)


if __name__ == "__main__":
    sys.exit(main())
