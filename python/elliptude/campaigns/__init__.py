"""Many runs with many settings, on all cores or on a cluster, stored and resumable: `elliptude.campaign`."""
