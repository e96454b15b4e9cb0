"""Filters: EKF, ES-EKF and UKF with one interface, what corrects them, and whether their covariance fits."""
