"""What hub, workers and learners say to each other."""
