"""A robot on wheels docks: by the paper's servo, by one that also moves aside, by a projective model."""
