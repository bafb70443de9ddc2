# The command `bench`, with its kernels compiled, for anybody but root:
#
#     docker build --tag tactsim .
#     docker run --rm --user "$(id -u):$(id -g)" --volume "$PWD:/work" tactsim
#
# The second line does the main job and leaves its files in results/runs of the current folder. What follows the
# image's name is another command of `bench`.
ARG PYTHON=3.13

FROM python:${PYTHON}-slim AS build
WORKDIR /source
RUN python -m venv --without-pip /opt/tactsim
# Dependencies are a layer of their own, which stays as long as the lock file does.
COPY requirements.lock .
RUN pip --python /opt/tactsim/bin/python install --no-cache-dir --requirement requirements.lock
COPY . .
# -I: what is compiled is the installed package, and not the one in this folder.
RUN pip --python /opt/tactsim/bin/python install --no-cache-dir --no-deps --no-build-isolation . \
    && NUMBA_CACHE_DIR=/opt/tactsim/kernels /opt/tactsim/bin/python -I -m tactsim.bench.compile_kernels --all \
    && chmod --recursive a+rwX /opt/tactsim/kernels

FROM python:${PYTHON}-slim
LABEL org.opencontainers.image.title="tactsim" \
      org.opencontainers.image.description="A harness for comparing ways to recognise an object by touch" \
      org.opencontainers.image.licenses="MIT"
COPY --from=build /opt/tactsim /opt/tactsim
# Numba must be able to write where it reads. Another processor than the one that built the image compiles the kernels anew.
ENV PATH=/opt/tactsim/bin:$PATH NUMBA_CACHE_DIR=/opt/tactsim/kernels
RUN useradd --create-home --uid 1000 tactsim && install --directory --owner tactsim /work
USER tactsim
WORKDIR /work
ENTRYPOINT ["bench"]
CMD ["run", "--estimator", "histogram", "--bins", "10000"]
