"""The REST interface: one router per resource."""
