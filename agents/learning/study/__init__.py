"""Study of the algorithms: ours against a peer's, and its table."""

STUDIES = {"peers": "study"}
