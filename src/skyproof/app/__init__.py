"""The use cases, callable from Python: open inputs, run the pipeline, write outputs."""
