"""Uploaded ONNX policies: checked from their bytes, and run where they can do no harm.

`checks.check_policy` decides whether an upload is taken, `interface.observation_spec` tells submitters what to upload,
`agent.OnnxPolicy` drives. Nothing is re-exported here: the sandboxed process imports this package and must stay small.
"""
