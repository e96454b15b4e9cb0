"""Expert of parking: curves, a planner, a tracker."""
