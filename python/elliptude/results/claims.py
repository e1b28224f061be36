"""What sets rest on, in words."""

from typing import Literal, TypeAlias, get_args

Claim: TypeAlias = Literal["unconditional", "conditional", "none"]
CLAIMS: tuple[Claim, ...] = get_args(Claim)
"""The words for `GuaranteedLog.claims`, the strongest first.

'unconditional': the truth is in the set if all bounds that the filter used hold. 'conditional': if, besides,
the measurements that were dropped were the wrong ones. 'none': there is no set.
"""
IF_PROPOSED_BOUNDS_HOLD: dict[str, str] = {
    "unconditional": "have a set that holds if the proposed bounds do",
    "conditional": "one that also rests on what was dropped",
    "none": "none",
}
"""The claims in words if the bounds are only proposals: then there is no guarantee."""
