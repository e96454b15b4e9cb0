FROM python:3.11-slim-bookworm

# make, and the system libraries that SUMO's wheels are linked to but do not bring (see SYSTEM_PACKAGES in the Makefile).
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install -y --no-install-recommends make libgl1 libx11-6 libxext6 libxrender1 libatomic1 \
    && rm -rf /var/lib/apt/lists/*

ENV PIP_NO_CACHE_DIR=1 \
    ORT_DISABLE_TELEMETRY=1

RUN useradd --create-home --uid 1000 dohyo && install -d -o dohyo -g dohyo /home/dohyo/dohyo
USER 1000:1000
WORKDIR /home/dohyo/dohyo
COPY --chown=dohyo:dohyo . .
RUN make setup

CMD ["make", "demo"]
