"""The aircraft in flight: JSBSim or a linear model, gusts, surfaces, and the sensors, the only path from truth to measurement."""
