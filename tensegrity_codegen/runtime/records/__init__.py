"""Results that several rooms read: plans and timed motions."""
