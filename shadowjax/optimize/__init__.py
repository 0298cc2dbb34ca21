"""Best parameters with certificates: virtual near distance n' and planes between depth slices."""
