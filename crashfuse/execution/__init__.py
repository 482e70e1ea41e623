"""How long computations run: kept in a cache, spread over workers, watched and cancelled."""
