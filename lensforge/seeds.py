"""Seeds of all rays in the program, from disjoint ranges: no lens is evaluated by the rays that designed it.

They follow from the seed of a run, ``seed`` from 0 to ``MOST``; a range is 2^40 wide, room for every seed of a run.
"""

MOST = 2**20  # the largest seed of a run
_STEPS = 1_000_003  # at most, of a search: every step has a seed of its own, resumed or not
_RANGE = 2**40
# 8 and 16 are those of benchmarks/convergence
_EVALUATION, _VERIFICATION, _FAR_FIELD, _PRESET, _VALIDATION, _OWN, _PARTS = (
    k * _RANGE for k in (1, 2, 4, 32, 64, 128, 256)
)
_PARTS_OF_STEPS, _VALIDATION_PARTS, OF_FILE = (k * _RANGE for k in (512, 1024, 2048))  # OF_FILE: divides a file's rays


def of_step(seed: int, step: int) -> int:
    """Seed for the rays of a gradient step, counted over all levels of a search."""
    return seed * _STEPS + step


def of_validation(seed: int, sample: int) -> int:
    """Seed for one of the two samples by which a search judges its progress."""
    return _VALIDATION + 2 * seed + sample


def of_replicate(seed: int, replicates: int, replicate: int, parts: int, part: int) -> int:
    """Seed for one of the ``parts`` in which a replicate of an evaluation is traced."""
    return _EVALUATION + (seed * replicates + replicate) * parts + part


def of_kind(seed: int, number: int) -> int:
    """Seed of the evaluation of one of several kinds of lens, in the place of ``seed``; of the first that itself."""
    return seed + number * 2 * (MOST + 1)


def of_verification(seed: int) -> int:
    """Seed for the rays that verify the exported part, the stray-light pass included."""
    return _VERIFICATION + seed


def of_own_rays(seed: int) -> int:
    """Seed for the rays that verification draws by itself."""
    return _OWN + seed


def of_far_field(seed: int, parts: int, part: int) -> int:
    """Seed for one of the ``parts`` of a far-field intensity."""
    return _FAR_FIELD + seed * parts + part


def of_preset_error(seed: int, scrambles: int, scramble: int) -> int:
    """Seed for one of the scrambles by which an evaluation measures the error of its preset's tables."""
    return _PRESET + seed * scrambles + scramble


def of_parts(seed: int) -> int:
    """Seed for the parts that are drawn from the tolerances."""
    return _PARTS + seed


def of_parts_of_steps(seed: int, block: int) -> int:
    """Seed for one block of the parts that a robust search draws for its steps."""
    return _PARTS_OF_STEPS + seed * _STEPS + block


def of_validation_parts(seed: int) -> int:
    """Seed for the parts by which a robust search judges its progress."""
    return _VALIDATION_PARTS + seed


def of_choice(seed: int) -> int:
    """Seed of the evaluation that chooses the best of several lenses: that of no run, which would judge them, too."""
    return MOST + 1 + seed
