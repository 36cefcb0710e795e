"""The contact of one pair: kinematics, penalty traction, tangent, explicit forces."""
