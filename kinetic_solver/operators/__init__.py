"""The parts of equation (2) as substeps and rates: transport, drift-diffusion, collisions, and what of them is exact together."""
