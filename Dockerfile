# As a command, which writes files of the user who runs it:
#   docker run --rm --user "$(id -u):$(id -g)" -v "$PWD:/data" seaclutter filter trial.mcap -o filtered.mcap
# As a cluster worker, which the scheduler and other workers must be able to reach:
#   docker run --rm --network host -v /mnt/nas:/mnt/nas -e DASK_CONFIG=/mnt/nas/dask --entrypoint dask seaclutter \
#     worker tls://scheduler:8786 --nworkers 8 --nthreads 1 --memory-limit 1GB --no-dashboard --dashboard-address 127.0.0.1:0
# docs/guide/cluster.md has more.
FROM python:3.13-slim AS build
WORKDIR /src
COPY pyproject.toml hatch_build.py README.md LICENSE ./
COPY seaclutter_cli seaclutter_cli
COPY seaclutter seaclutter
COPY configs configs
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheels .

FROM python:3.13-slim
ARG EXTRAS=all,cluster
# OpenMP for the neighbour search
RUN apt-get update && apt-get install --yes --no-install-recommends libgomp1 && rm -rf /var/lib/apt/lists/*
COPY --from=build /wheels /wheels
RUN pip install --no-cache-dir "$(ls /wheels/*.whl)[${EXTRAS}]" && rm -rf /wheels
RUN useradd --create-home --uid 1000 seaclutter
USER seaclutter
# Also writable for the user of --user, who has no home
ENV MPLCONFIGDIR=/tmp/matplotlib
WORKDIR /data
ENTRYPOINT ["seaclutter"]
CMD ["--help"]
