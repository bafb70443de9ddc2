"""A pytest plug-in for mutants: hypothesis tries the same examples each time and does not shrink what fails."""

from hypothesis import Phase, settings

settings.register_profile(
    "mutants", phases=[Phase.explicit, Phase.generate], derandomize=True, database=None, deadline=None
)
settings.load_profile("mutants")
