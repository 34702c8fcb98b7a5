# docker build -t ortilo-drake . && mkdir -p out && docker run --rm -it --shm-size 256m -v "$PWD/out:/home/ortilo/lab/out" ortilo-drake ortilo fly --camera projected
FROM debian:bookworm-slim
RUN apt-get update && apt-get install -y --no-install-recommends \
        ca-certificates git graphviz libegl1 libgl1 libgl1-mesa-dri libgomp1 libx11-6 make python3 python3-venv \
    && rm -rf /var/lib/apt/lists/*
RUN useradd --create-home ortilo
USER ortilo
WORKDIR /home/ortilo/lab
COPY --chown=ortilo . .
RUN make setup
ENV PATH="/home/ortilo/lab/.venv/bin:$PATH"
CMD ["ortilo", "fly", "--camera", "projected"]
