"""The options of PETSc that a scene may set: a list of those that are known to be harmless, and of no others.

PETSc has some two thousand options. Some load libraries or Python classes, start debuggers, open ports, or name files
that are overwritten; some change what those after them mean. So a scene has the options of the three solvers by name,
with numbers and words as values. The user's own command line may hold any.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

SOLVERS = r"(body|newton|qp)_"
"""The prefixes of ddmpi's solvers."""

WITHIN = (
    r"((mg_(levels(_\d+)?|coarse|fine)|sub|esteig|redundant|telescope|fieldsplit_\d+|"
    r"tao_(bnk|nls|ntr|ntl|lmvm|blmvm|bqnk|pdipm|almm))_)*"
)
"""The prefixes of solvers within a solver."""

PRINTING = (
    "(ksp|tao|tao_ls)_(view|monitor|converged_reason)|ksp_monitor_(short|true_residual|singular_value|max)|"
    "ksp_converged_rate|pc_view"
)
"""Options that print on the screen."""

SETTING = "|".join(
    f"{family}_({'|'.join(names.split())})"
    for family, names in {
        "ksp": """type rtol atol divtol max_it norm_type pc_side knoll lag_norm initial_guess_nonzero
            check_norm_iteration constant_null_space diagonal_scale diagonal_scale_fix reuse_preconditioner
            error_if_not_converged converged_maxits converged_use_(min_)?initial_residual_norm convergence_test min_it
            fischer_guess guess_type guess_fischer_(model|tol) guess_pod_(size|tol) use_explicittranspose matsolve_batch_size
            (gmres|gcr|lcd)_restart gmres_(haptol|preallocate|breakdown_tolerance|cgs_refinement_type)
            gmres_(classical|modified)gramschmidt fgmres_modifypc(ksp|nochange) lgmres_(augment|constant)
            [df]?gmres_(eigen|max_eigen|ratio|force|harmonic_ritz|improve) lcd_haptol cg_(single_reduction|radius)
            chebyshev_(eigenvalues|esteig|esteig_steps|esteig_noisy|kind) richardson_(scale|self_scale)
            bcgsl_(cxpoly|ell|mrpoly|pinv|xres) (pipe)?(fcg|gcr)_(mmax|nprealloc|truncation_type)
            pipelcg_(lmax|lmin|pipel) pipefgmres_shift qcg_trustregionradius""",
        "pc": r"""type use_amat
            factor_(column_pivot|diagonal_fill|fill|in_place|levels|mat_ordering_type|mat_solver_type)
            factor_(nonzeros_along_diagonal|pivot_in_blocks|shift_amount|shift_type|zeropivot)
            factor_reuse_(fill|ordering)
            (asm|gasm)_(blocks|local_blocks|local_type|overlap|type|total_subdomains) bjacobi_(local_)?blocks
            jacobi_(abs|fixdiagonal|type|rowl1_scale) eisenstat_(no_diagonal_scaling|omega) kaczmarz_(lambda|symmetric)
            sor_(backward|diagonal_shift|forward|its|lits|omega|symmetric|local_(backward|forward|symmetric))
            composite_(pcs|type) redundant_number telescope_(reduction_factor|subcomm_type)
            mg_(cycle_type|distinct_smoothup|galerkin|levels|multiplicative_cycles|type)
            gamg_(agg_nsmooths|aggressive_coarsening|aggressive_square_graph|asm_use_agg|coarse_eq_limit|esteig_ksp_type)
            gamg_(coarse_grid_layout_type|cpu_pin_coarse_grids|eigenvalues|low_memory_threshold_filter|mis_k_minimum_degree_ordering)
            gamg_(parallel_coarse_grid_solver|process_eq_limit|rank_reduction_factors|recompute_esteig|repartition)
            gamg_(reuse_interpolation|square_graph|threshold|threshold_scale|type|use_parallel_coarse_grid_solver|use_sa_esteig)
            gamg_esteig_ksp_(type|max_it|rtol) gamg_classical_(interp_threshold|nsmooths|type)
            hypre_type hypre_euclid_(bj|droptolerance|level) hypre_pilut_(factorrowsize|maxiter|tol)
            hypre_parasails_(filter|loadbal|nlevels|reuse|sym|thresh)
            hypre_boomeramg_(agg_nl|agg_num_paths|coarsen_type|cycle_type|grid_sweeps_(all|coarse|down|up)|interp_refine)
            hypre_boomeramg_(interp_type|max_coarse_size|max_iter|max_levels|max_row_sum|measure_type|min_coarse_size|no_cf)
            hypre_boomeramg_(nodal_coarsen|nodal_coarsen_diag|nodal_relaxation|numfunctions|p_max|strong_threshold|tol)
            hypre_boomeramg_(outer_relax_weight_(all|level)|relax_type_(all|coarse|down|up)|relax_weight_(all|level))
            hypre_boomeramg_(smooth_num_levels|smooth_type|truncfactor|vec_interp_(qmax|smooth|variant))
            fieldsplit_(block_size|type) svd_(ess_rank|zero_sing)""",
        "mat": r"""mumps_cntl_[1-57] mumps_icntl_([4678]|1[0-5]|2[34]|2[7-9]|3[5-8]|40|48|49|5[68])
            mumps_use_omp_threads
            cholmod_(dbound|default_nesdis|factor|final_(asis|ll|monotonic|pack|resymbol|super)|grow[012])
            cholmod_(maxrank|nmethods|nrelax|prefer_upper|supernodal_switch|zrelax)
            superlu_(colperm|rowperm|equil|iterrefine|symmetricmode|diagpivotthresh|replacetinypivot)
            superlu_dist_(3d|c|d|r|colperm|rowperm|equil|iterrefine|parsymbfact|replacetinypivot)
            coarsen_(type|misk_distance|strength_index_size|max_it|threshold)
            lmvm_(alpha|beta|eps|forward|hist_size|ksp_its|phi|rho|scale_type|sigma_hist|theta|tol)
            inode_limit no_inode ordering_amd_(aggressive|dense)""",
        "tao": r"""type python_type max_it max_funcs catol crtol fmin gatol grtol gttol steptol subset_type trust0
            recycle_history ksp_ew
            ls_(type|ftol|gtol|rtol|max_funcs|stepinit|stepmax|stepmin)
            ls_(ow)?armijo_(alpha|beta|beta_inf|memory_size|nondescending|reference_policy|replacement_policy|sigma)
            (lmvm|blmvm)_recycle blmvm_hist_size gpcg_maxpgits tron_maxgpits bqpip_predcorr
            (bnk|nls|ntr|ntl)_(alpha|eta|gamma|mu|nu|omega|theta)\d?(_i)? bnk_(as_step|as_tol|as_type|epsilon|sval)
            (bnk|nls)_(imax|imfac|imin|pgfac|pmax|pmgfac|pmin|pmsfac|psfac) (nls|ntl)_epsilon nls_sval
            (bnk|nls|ntr|ntl)_(init_type|update_type|max_radius|min_radius) bnk_max_cg_its bqnk_(max_cg_its|hist_size)
            bncg_(alpha|as_step|as_tol|as_type|bfgs_scale|delta_max|delta_min|dfp_scale|diag_scaling|dk_eta)
            bncg_(dynamic_restart|eps|hz_eta|hz_theta|min_quad|min_restart_num|neg_xi|no_scaling|spaced_restart)
            bncg_(theta|type|unscaled_restart|xi|zeta) cg_(delta_max|delta_min|eta|type)""",
    }.items()
)
"""Options with numbers, choices and truth values. Of MUMPS's, those that leave the problem and its output as they are:
icntl 1 to 3 are the numbers of Fortran's files, 22 writes factors to files, 5 and 18 to 21, 25, 26 and 30 to 33 ask for
something else than a solve."""

KINDS = {
    "prints": re.compile(f"{SOLVERS}{WITHIN}({PRINTING})", re.ASCII),
    "sets": re.compile(f"{SOLVERS}{WITHIN}({SETTING})", re.ASCII),
}

VALUE = re.compile(
    r"[+-]?(\d[\d.,e+-]*|\.\d[\d.e+-]*)|(?!.*(python|matlab|shell|saws))[a-z][\w-]*(,[a-z][\w-]*)*",
    re.ASCII | re.I,
)
"""Values of options that set something: numbers, and words that choose."""

SCREEN = re.compile("::ascii_[a-z_]+", re.ASCII)
"""Formats of what is printed. All else that such an option may be given is, or in some version was, a file's name."""

ONLY_TRUE = "monitor", "tao_"
"""Of options that print those that take no format: with one PETSc's monitors end the run by a signal."""

PYTHON = {"qp_tao_type": ("python",), "qp_tao_python_type": ("ddmpi.mprgp.MPRGP", "ddmpi.apg.APG")}
"""The only values that have to do with Python: ddmpi's own solvers."""


def kind(name: str) -> str:
    """Whether an option, with or without its dash, "prints" or "sets" something within the run; empty for all others,
    which a scene must not set. PETSc does not tell capitals from small letters."""
    bare = name.removeprefix("-").lower()
    return next((kind for kind, known in KINDS.items() if known.fullmatch(bare)), "")


def harmless_value(name: str, value: object) -> bool:
    """Whether a scene may give this value to an option that it may set."""
    bare, word = name.removeprefix("-").lower(), str(value)
    if kind(name) == "prints":
        takes_format = not any(part in bare for part in ONLY_TRUE)
        return value is True or (bool(SCREEN.fullmatch(word)) and takes_format)
    if bare in PYTHON and word in PYTHON[bare]:
        return True
    return bool(VALUE.fullmatch(word)) and not bare.endswith("python_type")


def check_petsc(options: Mapping[str, object]) -> None:
    """Raise ValueError for options of a scene that are not known to be harmless. Not collective."""
    for name, value in options.items():
        advice = f"give it on the command line, as -{name.lstrip('-')} …"
        reaches = "could start a program or name a file, which no scene may do"
        if not kind(name):
            raise ValueError(
                f"petsc.{name}: {reaches}; of PETSc's options a scene may set those of solvers, with the prefixes "
                "body_, newton_ and qp_, that print on the screen or have numbers and choices as values, see "
                f"docs/reference/security.md; {advice}"
            )
        if not harmless_value(name, value):
            words = "true" if kind(name) == "prints" else "a number or a word that chooses"
            raise ValueError(
                f"petsc.{name}: {reaches}, if it is {str(value)!r}; write {words}, or {advice}"
            )
