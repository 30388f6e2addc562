// The body of triangularise(), compiled for one kind of vector units (reflections.cpp includes it for each).
//
// Reflections are made for some columns at a time, a panel, and then applied to all columns behind these at once, as
// I - V T'V' (Schreiber and Van Loan, "A storage-efficient WY representation for products of Householder
// transformations", 1989), and only to rows with an entry in the panel: what is carried from the keyframe before is a
// triangle already, and a factor touches few of the columns.

typedef double Lanes __attribute__((vector_size(LANES * sizeof(double)), aligned(sizeof(double)), may_alias));

// The numbers from `begin` on, LANES of them; any address will do.
static inline Lanes &lanes(double *begin) { return *reinterpret_cast<Lanes *>(begin); }

// Make the reflections of columns `begin` to `end` of the touched rows, of which the first have their diagonal. V
// (count, PANEL) takes the vectors, T the triangle.
static void reflect_panel(double **touched, std::ptrdiff_t count, std::ptrdiff_t begin, std::ptrdiff_t end, double *V,
                          double (&T)[PANEL][PANEL]) {
    for (std::ptrdiff_t i = 0; i < count; ++i)
        for (std::ptrdiff_t p = 0; p < PANEL; ++p) V[i * PANEL + p] = begin + p < end ? touched[i][begin + p] : 0.0;
    for (std::ptrdiff_t p = 0; p < end - begin; ++p) {
        // v_p takes the place of its column; `with` is its product with all columns, those done and those to come.
        double with[PANEL] = {}, *own = V + p * PANEL;
        for (std::ptrdiff_t i = p + 1; i < count; ++i) {
            const double *row = V + i * PANEL, entry = row[p];
            for (std::ptrdiff_t q = 0; q < PANEL; ++q) with[q] += entry * row[q];
        }
        const double below = with[p], pivot = own[p];
        double *diagonal = touched[p] + begin + p;
        *diagonal = pivot;
        own[p] = 0.0;
        if (below == 0.0) continue;  // zero below the diagonal already
        const double length = std::copysign(std::sqrt(pivot * pivot + below), pivot);
        *diagonal = -length;
        own[p] = pivot + length;
        const double factor = 1.0 / (length * own[p]);  // 2 / v'v
        for (std::ptrdiff_t q = 0; q < PANEL; ++q) with[q] = factor * (with[q] + own[p] * own[q]);
        for (std::ptrdiff_t q = 0; q < p; ++q)
            for (std::ptrdiff_t r = q; r < p; ++r) T[q][p] -= T[q][r] * with[r];
        T[p][p] = factor;
        for (std::ptrdiff_t q = 0; q <= p; ++q) with[q] = 0.0;
        for (std::ptrdiff_t i = p; i < count; ++i) {
            double *row = V + i * PANEL;
            const double entry = row[p];
            for (std::ptrdiff_t q = 0; q < PANEL; ++q) row[q] -= entry * with[q];
        }
    }
    for (std::ptrdiff_t i = 0; i < count; ++i)  // what is right of the diagonal belongs to the triangle, not to V
        for (std::ptrdiff_t p = 0; p < end - begin; ++p) {
            if (p == i) continue;
            touched[i][begin + p] = p > i ? V[i * PANEL + p] : 0.0;
            if (p > i) V[i * PANEL + p] = 0.0;
        }
}

// Apply the reflections to the CHUNK numbers from `chunk` on of each touched row, but not to the first `done` of these.
static inline void apply_panel(double **touched, std::ptrdiff_t count, std::ptrdiff_t chunk, std::ptrdiff_t done,
                               const double *V, const double (&T)[PANEL][PANEL]) {
    constexpr std::ptrdiff_t PARTS = Rows::CHUNK / LANES;
    Lanes w[PANEL][PARTS] = {}, x[PANEL][PARTS] = {};
    for (std::ptrdiff_t i = 0; i < count; ++i) {
        double *row = touched[i] + chunk;
        const double *v = V + i * PANEL;
        for (std::ptrdiff_t part = 0; part < PARTS; ++part) {
            const Lanes numbers = lanes(row + part * LANES);
            for (std::ptrdiff_t p = 0; p < PANEL; ++p) w[p][part] += v[p] * numbers;
        }
    }
    for (std::ptrdiff_t p = 0; p < PANEL; ++p)
        for (std::ptrdiff_t q = 0; q <= p; ++q)
            for (std::ptrdiff_t part = 0; part < PARTS; ++part) x[p][part] += T[q][p] * w[q][part];
    for (std::ptrdiff_t c = 0; c < done; ++c)
        for (std::ptrdiff_t p = 0; p < PANEL; ++p) x[p][c / LANES][c % LANES] = 0.0;
    for (std::ptrdiff_t i = 0; i < count; ++i) {
        double *row = touched[i] + chunk;
        const double *v = V + i * PANEL;
        for (std::ptrdiff_t part = 0; part < PARTS; ++part) {
            Lanes sum = v[0] * x[0][part];
            for (std::ptrdiff_t p = 1; p < PANEL; ++p) sum += v[p] * x[p][part];
            lanes(row + part * LANES) -= sum;
        }
    }
}

static void triangularised(double *A, std::ptrdiff_t stride, std::ptrdiff_t rows, std::ptrdiff_t last, double **touched,
                           double *V) {
    for (std::ptrdiff_t begin = 0; begin < last; begin += PANEL) {
        const std::ptrdiff_t end = begin + PANEL < last ? begin + PANEL : last;
        std::ptrdiff_t count = 0;
        for (std::ptrdiff_t i = begin; i < rows; ++i) {
            double *row = A + i * stride;
            bool any = i < end;
            for (std::ptrdiff_t j = begin; j < end; ++j) any |= row[j] != 0.0;
            if (any) touched[count++] = row;
        }
        double T[PANEL][PANEL] = {};
        reflect_panel(touched, count, begin, end, V, T);
        for (std::ptrdiff_t chunk = end / Rows::CHUNK * Rows::CHUNK; chunk < stride; chunk += Rows::CHUNK)
            apply_panel(touched, count, chunk, end - chunk, V, T);
    }
}
