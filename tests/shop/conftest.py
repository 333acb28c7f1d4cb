from coarse_splines import coarse_splines  # noqa: F401  # of every module of this folder
