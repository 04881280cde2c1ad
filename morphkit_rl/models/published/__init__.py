"""Networks with weights of the published programs."""
