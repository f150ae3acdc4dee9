"""Which sparse forces l1 minimisation is certain to find."""

from backsight.sparse.recovery.certificate import check_recovery as check_recovery
