"""Turn samples into signals: acquisition, tracking, telemetry, observables. It never decides who is authentic."""
