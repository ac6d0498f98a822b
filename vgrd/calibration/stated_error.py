"""What a 95 % figure is of and what it includes, in one wording for whatever tells one.

The same covariance gives them all. They differ in which targets and turns of the object are taken together, in
whether holes in the pictures were evidence, and in whether errors that no session shows are assumed.
"""

from vgrd.model import Policy

EVERY_PICTURE = "the worst target in the worst of the session's pictures"  # of `solve`
THIS_PICTURE = "this target as the object stands now"  # of `ec`


def u95_in_words(of: str, policy: Policy, holes: int, *, assumes: bool = False) -> str:
    """Beside a figure. of: whose miss; holes: sightings that were evidence; assumes: as `vgrd budget` does."""
    seen = f"with {holes} sightings of holes" if holes else "without holes in the pictures"
    assumed = "with" if assumes else "without"
    return (
        f"95 % of the misses of {of}, policy {policy.value}, {seen}, {assumed} assumed errors of print, "
        "intrinsics and drift"
    )


def each_target(*turns_deg: float) -> str:
    """Each target by itself, the object turned so since it was touched."""
    turns = " and ".join(f"{turn:.0f}" for turn in turns_deg)
    mean = ", mean of both" if len(turns_deg) == 2 else ""
    return f"each target with the object turned by {turns} degrees{mean}"
