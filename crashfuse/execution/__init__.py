"""Long computations: cached, distributed over workers, monitored and cancelled."""
